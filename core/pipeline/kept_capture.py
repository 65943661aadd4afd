"""A capture whose cameras were estimated, kept beside a run's checkpoint: a run that goes on estimates none again."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ..capture.files import FRAMES_FILE, make_keys
from ..capture.material import common_folder, find_material, masks_of
from ..capture.model import MIN_VIEWS, Capture, CaptureWarning, Estimate, PinholeCamera, View
from ..capture.reader import read_cameras
from ..capture.sfm_job import SfmSettings
from ..capture.sfm_verdict import frames_file
from ..capture.source import MOST_VIEWS, rigid_pose
from ..capture.upright import UpDirection
from ..capture.views import find_again
from ..files.states import SavedState, State
from ..files.untrusted import is_file, opened
from ..intake.kinds import is_archive

_FORMAT = "cvdgs-kept-capture-2"  # another one whenever what is kept changes
_WHERE = "--resume"
_MOST_BYTES = 1 << 42  # of a film; only a block of it is held at a time
_BLOCK = 1 << 20


def digest_of(path: Path, cameras: str, max_size: int, tag_side: float | None) -> str:
    """What a kept capture has to agree on with a run: the version, how it was read, and every byte it was made of.

    Returns:
        "" where nothing would be estimated.

    Raises:
        InputError: there is nothing usable.
    """
    digest = hashlib.sha256(f"{_FORMAT} {__version__} {max_size} {tag_side} {SfmSettings()!r}\n".encode())
    if is_archive(path) and is_file(path):
        files = {path.name: path}
        digest.update(f"{cameras}\n".encode())  # which of them are taken is not known before it is unpacked
    elif read_cameras(path, cameras=cameras) is not None:
        return ""
    else:
        files = _originals(path)
    for name, path in files.items():
        own = hashlib.sha256()
        with opened(path, most_bytes=_MOST_BYTES) as file:
            while block := file.read(_BLOCK):
                own.update(block)
        digest.update(f"{name}\0{own.hexdigest()}\n".encode())
    return digest.hexdigest()


def _originals(path: Path) -> dict[str, Path]:
    """The files that a capture with estimated cameras is made of, by name."""
    material = find_material(path)
    files = {name: material.folder / name for name in (*material.photographs, *material.videos)}
    again = find_again(path, {name: files[name] for name in material.photographs})
    masks = masks_of(material)
    files.update({f"mask of {name}": mask for name, mask in masks.files.items()})
    files.update({f"second of {name}": second for name, second in again.items()})
    folder, _ = common_folder(material)
    if material.photographs and (listed := frames_file(folder, path)):
        files[FRAMES_FILE] = listed
    return files


def to_state(capture: Capture, warnings: Sequence[CaptureWarning]) -> State:
    """Everything of a capture with estimated cameras, to the last bit.

    Args:
        warnings: that were given while it was read.
    """
    estimate, up = capture.estimate, capture.up
    assert estimate is not None
    assert up is not None
    return {
        "format": capture.format,
        "views": _numbered([_view_state(view) for view in capture.views]),
        "points": capture.points,
        "point_colors": capture.point_colors,
        "warnings": _numbered([{"name": warning.name, "message": warning.message} for warning in warnings]),
        "estimate": {
            "photographs": estimate.photographs,
            "placed": estimate.placed,
            "pieces": np.array(estimate.pieces, np.int64),
            "focal_ratios": np.array(estimate.focal_ratios, np.float64),
            "method": estimate.method,
            **_there(sheet=estimate.sheet),
        },
        "up": {"direction": up.direction, "source": up.source},
        **_there(metres_per_unit=capture.metres_per_unit),
    }


def from_state(state: SavedState, source: Path) -> Capture:
    """The capture of `to_state`; its warnings are those that were given while it was read.

    Args:
        source: the capture that the run was given.

    Raises:
        InputError: it is damaged.
    """
    views = tuple(_view(part) for part in _parts(state, "views"))
    keys = [view.key for view in views]
    if len(keys) < MIN_VIEWS or make_keys([f"{key}.png" for key in keys]) != keys:
        state.refuse("its views have unusable names")
    points, up = state.array("points", np.float32, None, 3), state.part("up")
    warnings = [
        CaptureWarning(part.value("name", str), part.value("message", str)) for part in _parts(state, "warnings")
    ]
    return Capture(
        source,
        state.value("format", str),
        views,
        points,
        state.array("point_colors", np.uint8, len(points), 3),
        tuple(warnings),
        _estimate(state.part("estimate")),
        UpDirection(up.array("direction", np.float64, 3), up.value("source", str)),
        state.value("metres_per_unit", float) if "metres_per_unit" in state else None,
    )


def _numbered(parts: Sequence[State]) -> State:
    return {"count": len(parts), **{str(number): part for number, part in enumerate(parts)}}


def _parts(saved: SavedState, name: str) -> list[SavedState]:
    numbered = saved.part(name)
    return [numbered.part(str(number)) for number in range(numbered.number("count", 0, MOST_VIEWS))]


def _there(**values: Any) -> State:
    return {name: value for name, value in values.items() if value is not None}


def _view_state(view: View) -> State:
    camera = view.camera
    return {
        "key": view.key,
        "source": str(view.source),
        "lens": np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
        "pose": view.world_to_camera,
        "image": view.image,
        **_there(alpha=view.alpha, again=view.again, mask=view.mask, time=view.time),
    }


def _view(saved: SavedState) -> View:
    key, lens = saved.value("key", str), saved.array("lens", np.float64, 4)
    if not np.isfinite(lens).all():
        saved.refuse("lens is not finite")
    pose, skewed = rigid_pose(saved.array("pose", np.float64, 4, 4), frame=key, where=_WHERE)
    if skewed:
        saved.refuse("pose is no rotation")
    image = saved.array("image", np.uint8, None, None, 3)
    height, width = image.shape[:2]
    return View(
        key,
        Path(saved.value("source", str)),
        PinholeCamera(width, height, *lens.tolist()),
        pose,
        image,
        alpha=saved.array("alpha", np.uint8, height, width) if "alpha" in saved else None,
        again=saved.array("again", np.uint8, height, width, 3) if "again" in saved else None,
        time=saved.value("time", float) if "time" in saved else None,
        mask=saved.array("mask", np.bool_, height, width) if "mask" in saved else None,
    )


def _estimate(saved: SavedState) -> Estimate:
    return Estimate(
        photographs=saved.number("photographs", MIN_VIEWS, MOST_VIEWS),
        placed=saved.number("placed", MIN_VIEWS, MOST_VIEWS),
        pieces=tuple(saved.array("pieces", np.int64, None).tolist()),
        focal_ratios=tuple(saved.array("focal_ratios", np.float64, None).tolist()),
        method=saved.value("method", str),
        sheet=saved.array("sheet", np.uint8, None, None, 3) if "sheet" in saved else None,
    )
