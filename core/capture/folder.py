"""A capture in the worker's normalised form: pinhole cameras, undistorted PNG images, sparse points. numpy only.

``transforms.json`` in nerfstudio's convention, with the intrinsics in every frame, as `core.capture.normalised` writes
it; ``images/<key>.png``; and ``points.ply``.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.ply import VertexTable
from ..files.untrusted import explained, opened, read_json
from ..runs.layout import CAMERAS_FILE, POINTS_FILE
from .model import PinholeCamera

_RUN_AGAIN = "choose the output folder of a finished run"
_IMPORT_AGAIN = "import the capture again"
_LEAST_UP = 1e-6  # length of a vector that is a direction, also of a mean of these
_ORTHONORMAL_TOLERANCE = 1e-3
_MOST = 1e18  # of pixels and of scene units: far beyond any use, and its square is still a float32
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")

# Offset of the colour type in a PNG's header chunk, and the two types that have alpha (PNG specification, 11.2.2).
_PNG_COLOR_TYPE = 25
_PNG_TYPES_WITH_ALPHA = (4, 6)

_MOST_VIEWS = 20_000  # as many as a worker reads
_MOST_POINT_BYTES = 1 << 30
_COLOR = ("red", "green", "blue")
_POINT_PROPERTIES = ("x", "y", "z", *_COLOR)
_FOREIGN_POINTS = "not the points that a worker writes"


@dataclass(frozen=True)
class CaptureView:
    """A camera of the capture.

    Attributes:
        key: the view's name in file names.
        camera: intrinsics.
        camera_to_world: (4, 4) rigid, OpenGL axes.
        image: its undistorted photograph, or None where the file is not there.
    """

    key: str
    camera: PinholeCamera
    camera_to_world: NDArray[np.float64]
    image: Path | None = None

    @property
    def world_to_camera(self) -> NDArray[np.float64]:
        """(4, 4) rigid, OpenCV axes."""
        pose = np.eye(4)
        pose[:3, :3] = (self.camera_to_world[:3, :3] * (1.0, -1.0, -1.0)).T
        pose[:3, 3] = -pose[:3, :3] @ self.camera_to_world[:3, 3]
        return pose


@dataclass(frozen=True)
class CaptureFolder:
    """What the folder of a normalised capture holds.

    Attributes:
        views: at least one, in file order.
        is_cut_out: whether photographs have transparency.
        up: (3,) unit vector, or None where the worker did not say what is up.
        metres_per_unit: None where nobody has measured it.
    """

    views: tuple[CaptureView, ...]
    is_cut_out: bool
    up: NDArray[np.float64] | None = None
    metres_per_unit: float | None = None


def mean_up(views: Sequence[CaptureView]) -> NDArray[np.float64]:
    """(3,) the cameras' mean up direction: photographers hold them upright. +Z where they cancel out."""
    mean = np.stack([view.camera_to_world for view in views])[:, :3, 1].mean(axis=0)
    length = float(np.linalg.norm(mean))
    return mean / length if length > _LEAST_UP else np.array([0.0, 0.0, 1.0])


def is_normalised(folder: Path) -> bool:
    """Whether `folder` holds a capture that Blender can use as it is: pinhole cameras, PNG images, readable points."""
    try:
        frames = _frames(folder / CAMERAS_FILE)
        read_points(folder)
        return bool(frames) and all(_is_pinhole(frame) for frame in frames)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, InputError):
        return False


def read_capture_folder(folder: Path) -> CaptureFolder:
    """Read the cameras in `folder`.

    Raises:
        InputError: the cameras are missing or damaged.
    """
    path = folder / CAMERAS_FILE
    if not path.is_file():
        raise InputError("no such file", where=path, remedy=_RUN_AGAIN)
    try:
        frames = _frames(path)
        views = tuple(_read_view(frame, path) for frame in frames)
        up = _read_up(frames[0].get("up")) if frames else None
        unit = _read_unit(frames[0].get("metres_per_unit")) if frames else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RuntimeError) as error:
        raise InputError(f"not the cameras of a run{explained(error)}", where=path, remedy=_RUN_AGAIN) from None
    if not views:
        raise InputError("it lists no cameras", where=path, remedy=_RUN_AGAIN)
    is_cut_out = any(view.image is not None and _has_alpha(view.image) for view in views)
    return CaptureFolder(views, is_cut_out, up, unit)


def _read_up(stated: Any) -> NDArray[np.float64] | None:
    if stated is None:
        return None
    up = np.array(stated, np.float64)
    norm = float(np.linalg.norm(up))
    if up.shape != (3,) or not np.isfinite(norm) or norm < _LEAST_UP:
        raise ValueError("up is no direction")
    return up / norm


def _read_unit(stated: Any) -> float | None:
    if stated is None:
        return None
    metres = float(stated)
    if not 0.0 < metres < np.inf:
        raise ValueError("a unit is no number of metres")
    return metres


def _frames(path: Path) -> list[Mapping[str, Any]]:
    """The frames of a camera file; what one does not say, the file says for all.

    Raises:
        InputError: the file cannot be read, or has more frames than a capture may have views.
        KeyError, TypeError: it is no camera file.
    """
    document = read_json(path, remedy=_RUN_AGAIN, strict=False)
    if len(document["frames"]) > _MOST_VIEWS:
        raise InputError(f"it has more than {_MOST_VIEWS:,} cameras", where=path, remedy=_RUN_AGAIN)
    return [ChainMap(frame, document) for frame in document["frames"]]


def read_points(folder: Path) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(P, 3) positions and (P, 3) display-referred sRGB in [0, 1] of the sparse points; P is 0 where there are none.

    Raises:
        InputError: the file is not what the worker writes, or cut short.
    """
    path = folder / POINTS_FILE
    if not path.is_file():
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    with opened(path, most_bytes=_MOST_POINT_BYTES, remedy=_IMPORT_AGAIN) as file:
        table = VertexTable(file, path, noun="points", remedy=_IMPORT_AGAIN)
        table.require(_POINT_PROPERTIES, _FOREIGN_POINTS)
        if any(table.declared_type(channel) != np.uint8 for channel in _COLOR):
            raise InputError(_FOREIGN_POINTS, where=path, remedy=_IMPORT_AGAIN)
        blocks = list(table.blocks())
    points = np.concatenate(blocks) if blocks else np.zeros(0, [(name, "f4") for name in _POINT_PROPERTIES])
    x, y, z, *channels = (points[name].astype(np.float32) for name in _POINT_PROPERTIES)
    return np.stack([x, y, z], axis=1), np.stack(channels, axis=1) / np.float32(255.0)


def _read_view(frame: Mapping[str, Any], path: Path) -> CaptureView:
    key = PurePosixPath(frame["file_path"]).stem
    intrinsics = [float(frame[name]) for name in ("fl_x", "fl_y", "cx", "cy")]
    camera = PinholeCamera(int(frame["w"]), int(frame["h"]), *intrinsics)
    pose = np.array(frame["transform_matrix"], np.float64)
    sizes = (camera.width, camera.height, camera.fx, camera.fy)
    if not np.isfinite(intrinsics).all() or min(sizes) <= 0 or max(*sizes, *map(abs, intrinsics)) > _MOST:
        raise InputError(f"view '{key}' has an impossible camera", where=path, remedy=_RUN_AGAIN)
    if pose.shape != (4, 4) or not (np.abs(pose) <= _MOST).all() or not _is_rotation(pose[:3, :3]):
        raise InputError(f"view '{key}' has no rigid pose", where=path, remedy=_RUN_AGAIN)
    return CaptureView(key, camera, pose, _image_of(path.parent, str(frame["file_path"])))


def _is_pinhole(frame: Mapping[str, Any]) -> bool:
    if frame.get("camera_model", "PINHOLE") != "PINHOLE" or any(frame.get(name) for name in _DISTORTION):
        return False
    # Other formats may hold an orientation that Blender ignores.
    is_plain = PurePosixPath(frame["file_path"]).suffix.lower() == ".png"
    return is_plain and all(name in frame for name in ("w", "h", "fl_x", "fl_y", "cx", "cy"))


def _is_rotation(matrix: NDArray[np.float64]) -> bool:
    return np.abs(matrix @ matrix.T - np.eye(3)).max() < _ORTHONORMAL_TOLERANCE and np.linalg.det(matrix) > 0.0


def _image_of(folder: Path, name: str) -> Path | None:
    """The photograph of a view: inside of the folder, or none."""
    path = (folder / name).resolve()
    return path if path.is_relative_to(folder.resolve()) and path.is_file() else None


def _has_alpha(path: Path) -> bool:
    """Whether a photograph is a cut-out."""
    with open(path, "rb") as file:
        header = file.read(_PNG_COLOR_TYPE + 1)
    return (
        len(header) > _PNG_COLOR_TYPE
        and header.startswith(b"\x89PNG")
        and header[_PNG_COLOR_TYPE] in _PNG_TYPES_WITH_ALPHA
    )
