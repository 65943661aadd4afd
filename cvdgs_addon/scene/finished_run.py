"""A finished run as it lies in its folder: cameras, Gaussians and colour layers, read and checked. numpy only."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.splats.gaussians import Gaussians
from ...core.splats.ply import read_ply
from .intrinsics import Intrinsics

CAMERAS_FILE = "capture/transforms.json"
GAUSSIANS_FILE = "splats.ply"
PARTIAL_FOLDER = ".blender.partial"
"""Where the conversion makes its files before it moves them into place; to be deleted whenever nothing runs."""

_LAYER_PATTERN = "splats.*.ply"
_RUN_AGAIN = "choose the output folder of a finished run"
_ORTHONORMAL_TOLERANCE = 1e-3

# Offset of the colour type in a PNG's header chunk, and the two types that have alpha (PNG specification, 11.2.2).
_PNG_COLOR_TYPE = 25
_PNG_TYPES_WITH_ALPHA = (4, 6)


@dataclass(frozen=True)
class RunView:
    """A camera of the capture.

    Attributes:
        key: the view's name in file names.
        camera: intrinsics.
        camera_to_world: (4, 4) rigid, OpenGL axes.
    """

    key: str
    camera: Intrinsics
    camera_to_world: NDArray[np.float64]


@dataclass(frozen=True)
class FinishedRun:
    """What a run folder holds for Blender.

    Attributes:
        folder: the run folder.
        views: at least one, in file order.
        gaussians: geometry and original colours.
        layers: (N, 3) colours by layer name.
        background: sRGB that the Gaussians were trained over: black, or white for cut-outs.
    """

    folder: Path
    views: tuple[RunView, ...]
    gaussians: Gaussians
    layers: Mapping[str, NDArray[np.float32]]
    background: tuple[float, float, float]

    def view(self, key: str) -> RunView:
        """The view called `key`.

        Raises:
            InputError: there is none.
        """
        for view in self.views:
            if view.key == key:
                return view
        names = ", ".join(view.key for view in self.views[:3])
        raise InputError(f"no view is called '{key}'", where=self.folder, remedy=f"choose one of {names}, ...")


def read_run(folder: str | Path) -> FinishedRun:
    """Read the run in `folder`.

    Raises:
        InputError: a file is missing or damaged, or a layer does not belong to these Gaussians.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such folder", where=folder, remedy=_RUN_AGAIN)
    views, background = _read_cameras(folder / CAMERAS_FILE)
    gaussians = read_ply(_existing(folder / GAUSSIANS_FILE))
    layers = {}
    for path in sorted(folder.glob(_LAYER_PATTERN)):
        name = path.name.removeprefix("splats.").removesuffix(".ply")
        layer = read_ply(path)
        if len(layer) != len(gaussians):
            raise InputError(
                f"{len(layer)} Gaussians, but {GAUSSIANS_FILE} has {len(gaussians)}", where=path, remedy=_RUN_AGAIN
            )
        layers[name] = layer.base_colors
    return FinishedRun(folder, views, gaussians, layers, background)


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise InputError("no such file", where=path, remedy=_RUN_AGAIN)
    return path


def _read_cameras(path: Path) -> tuple[tuple[RunView, ...], tuple[float, float, float]]:
    try:
        document = json.loads(_existing(path).read_text(encoding="utf-8"))
        frames = document["frames"]
        views = tuple(_read_view({**document, **frame}, path) for frame in frames)
        cut_out = any(_has_alpha(path.parent, str(frame["file_path"])) for frame in frames)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"not the cameras of a run ({type(error).__name__}: {error})", where=path, remedy=_RUN_AGAIN
        ) from None
    if not views:
        raise InputError("it lists no cameras", where=path, remedy=_RUN_AGAIN)
    return views, (1.0, 1.0, 1.0) if cut_out else (0.0, 0.0, 0.0)


def _read_view(frame: Mapping[str, Any], path: Path) -> RunView:
    key = PurePosixPath(frame["file_path"]).stem
    intrinsics = [float(frame[name]) for name in ("fl_x", "fl_y", "cx", "cy")]
    camera = Intrinsics(int(frame["w"]), int(frame["h"]), *intrinsics)
    pose = np.array(frame["transform_matrix"], np.float64)
    sizes = (camera.width, camera.height, camera.fx, camera.fy)
    if not np.isfinite(intrinsics).all() or min(sizes) <= 0:
        raise InputError(f"view '{key}' has an impossible camera", where=path, remedy=_RUN_AGAIN)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or not _is_rotation(pose[:3, :3]):
        raise InputError(f"view '{key}' has no rigid pose", where=path, remedy=_RUN_AGAIN)
    return RunView(key, camera, pose)


def _is_rotation(matrix: NDArray[np.float64]) -> bool:
    return np.abs(matrix @ matrix.T - np.eye(3)).max() < _ORTHONORMAL_TOLERANCE and np.linalg.det(matrix) > 0.0


def _has_alpha(folder: Path, name: str) -> bool:
    """Whether a photograph of the normalised capture is a cut-out. A missing one is none: its pixels are not needed."""
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()) or not path.is_file():
        return False
    with open(path, "rb") as file:
        header = file.read(_PNG_COLOR_TYPE + 1)
    return (
        len(header) > _PNG_COLOR_TYPE
        and header.startswith(b"\x89PNG")
        and header[_PNG_COLOR_TYPE] in _PNG_TYPES_WITH_ALPHA
    )
