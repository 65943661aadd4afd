"""Camera files ``transforms.json`` of nerfstudio, instant-ngp, BlenderNeRF and the NeRF synthetic scenes.

Poses are camera-to-world with OpenGL axes. ``applied_transform`` and ``applied_scale`` of nerfstudio say what was done
to poses and points alike when the file was written; both are in one frame already, so they are not applied again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
import pycolmap

from ..errors import InputError
from ..files.untrusted import is_file, is_folder, is_there, read_json
from ..runs.layout import MASKS_FOLDER
from .colmap import SEARCHED_DEPTH, check_camera, refuse_several
from .copies import reduced_folders
from .files import (
    IMAGE_EXTENSIONS,
    TRANSFORMS_FILES,
    Spelling,
    quote_first,
    relative_name,
    resolve_inside,
    visible_files,
)
from .images import read_header
from .points import read_point_cloud
from .source import (
    LARGEST_NUMBER,
    MOST_VIEWS,
    OPENGL_TO_OPENCV,
    SMEAR_KEY,
    SourceModel,
    SourceView,
    invert_rigid,
    rigid_pose,
)

_MAX_STATED_SIDE = 1_000_000
_EXPORT_AGAIN = "copy or export the file again"

_PERSPECTIVE = frozenset(
    {"", "PERSPECTIVE", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"}
)
_FISHEYE = frozenset({"FISHEYE", "OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"})
_BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_KANNALA_BRANDT = ("k1", "k2", "k3", "k4")
# nerfstudio also takes a list instead of a number a key, in this order.
_LIST, _LISTED = "distortion_params", ("k1", "k2", "k3", "k4", "p1", "p2")


def find_transforms(folder: Path) -> Path | None:
    """The camera file of the capture in `folder`, if it has one."""
    return next((folder / name for name in TRANSFORMS_FILES if (folder / name).exists()), None)


def find_nested_transforms(folder: Path) -> Path | None:
    """The camera file of the capture somewhere below `folder`; the nearest ones alone, and none that a run has made.

    Raises:
        InputError: there are several captures.
    """
    files = [file.relative_to(folder) for file in visible_files(folder) if file.name in TRANSFORMS_FILES]
    depths = {file.parent: len(file.parts) - 1 for file in files if len(file.parts) - 1 <= SEARCHED_DEPTH}
    least = min(depths.values(), default=0)
    nearest = sorted(parent for parent, depth in depths.items() if depth == least)
    refuse_several([parent.as_posix() for parent in nearest], folder)
    return find_transforms(folder / nearest[0]) if nearest else None


def read_transforms(file: Path, folder: Path | None = None, root: Path | None = None) -> SourceModel:
    """Read a camera file; frames without an image file are left out, and counted in a warning.

    ``k4``, ``k5`` and ``k6`` are the denominator of OpenCV's rational model where ``camera_model`` is ``FULL_OPENCV``
    or one of the last two is not 0. Elsewhere ``k4`` continues the polynomial of ``k1``, ``k2`` and ``k3``, as
    nerfstudio writes it for RealityScan and Metashape, and is refused: no model of COLMAP has that.

    Args:
        folder: what names are relative to; None is the file's own. It may also be the images' folder itself.
        root: what no image or mask may lie outside of; None is what names are relative to.

    Raises:
        InputError: not JSON, cut, without frames, or with unusable poses, intrinsics or names.
    """
    document = read_json(file, remedy=_EXPORT_AGAIN, strict=False)  # a number that is not finite is named below
    frames = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise InputError("the file has no list of frames", where=file, remedy="give a transforms.json with cameras")
    if len(frames) > MOST_VIEWS:
        raise InputError(
            f"the file has {len(frames):,} frames, the limit is {MOST_VIEWS:,}",
            where=file,
            remedy="split the capture, or keep every second photograph",
        )
    names_in = _image_root(folder, frames) if folder else file.parent
    return _Reader(file, document, names_in, root or folder or file.parent).read(frames)


def _image_root(folder: Path, frames: list[dict[str, Any]]) -> Path:
    """`folder`, or the one above it where `folder` is the images' own and the names begin with it."""
    first = frames[0].get("file_path")
    own = isinstance(first, str) and Path(first).parts[:1] == (folder.name,) and not is_there(folder / folder.name)
    return folder.parent if own else folder


class _Reader:
    """Reads the frames of one file, whose names are relative to `folder` and must lead into `root`."""

    def __init__(self, file: Path, document: dict[str, Any], folder: Path, root: Path) -> None:
        self._file = file
        self._folder = folder
        self._root = root
        self._document = document
        self._cameras: dict[tuple, pycolmap.Camera] = {}
        self._spelling = Spelling()
        self._without_masks: list[str] = []

    def read(self, frames: list[dict[str, Any]]) -> SourceModel:
        model = SourceModel("transforms", self._file, [])
        names = [self._name(index, frame) for index, frame in enumerate(frames)]
        self._spelling = Spelling(names)
        missing, reshaped = [], []
        for name, frame in zip(names, frames, strict=True):
            matrix, repaired = self._pose(frame, name)
            path = self._image(name)
            if path is None:
                missing.append(name)
                continue
            if repaired:
                reshaped.append(name)
            camera, size_known = self._camera(frame, name, path)
            mask, smear = self._mask(frame, name), self._smear(frame, name)
            model.views.append(SourceView(name, path, camera, matrix, size_known, mask=mask, smear=smear))
        self._refuse_repeated(model)
        model.warn_about_views(missing, reshaped, len(frames), self._folder)
        if self._without_masks:
            what = f"the masks of {len(self._without_masks)} photographs are missing, so that all of these is looked at"
            model.warn("missing-masks", f"{self._file}: {what}: {quote_first(self._without_masks)}")
        self._add_points(model)
        return model

    def _refusal(self, what: str, remedy: str = _EXPORT_AGAIN) -> InputError:
        return InputError(what, where=self._file, remedy=remedy)

    def _refuse_repeated(self, model: SourceModel) -> None:
        counts = Counter(view.path.resolve() for view in model.views)
        repeated = [view.name for view in model.views if counts[view.path.resolve()] > 1]
        if repeated:
            raise InputError(
                f"two frames have the same image: {quote_first(sorted(set(repeated)))}",
                where=self._file,
                remedy="keep one of them",
            )

    def _name(self, index: int, frame: dict[str, Any]) -> str:
        """What a frame calls its image, relative to the file where that can be."""
        name = frame.get("file_path")
        if not isinstance(name, str) or not name:
            raise self._refusal(f"frame {index} has no file_path")
        return relative_name(self._folder, name)

    def _image(self, name: str) -> Path | None:
        """The image file of a frame, or a smaller copy: some datasets bring ``images_4`` instead of ``images``."""
        found = self._image_called(name)
        path = PurePosixPath(name)
        if found is not None or path.parent.name != "images" or is_folder(self._folder / path.parent):
            return found
        reduced = (folder.name for folder in reduced_folders(self._folder / path.parent))
        copies = (self._image_called((path.parent.with_name(folder) / path.name).as_posix()) for folder in reduced)
        return next(filter(None, copies), None)

    def _image_called(self, name: str) -> Path | None:
        """The image file `name`, whose extension the NeRF synthetic layout leaves out."""
        path = resolve_inside(self._folder, name, where=self._file, root=self._root)
        for extension in ("", *IMAGE_EXTENSIONS, *(extension.upper() for extension in IMAGE_EXTENSIONS)):
            if is_file(path.with_name(path.name + extension)):
                return resolve_inside(self._folder, name + extension, where=self._file, root=self._root)
        for extension in ("", *IMAGE_EXTENSIONS):
            respelled = self._spelling.find(self._folder, name, extension)
            if is_file(self._folder / respelled):
                return resolve_inside(self._folder, respelled, where=self._file, root=self._root)
        return None

    def _mask(self, frame: dict[str, Any], name: str) -> Path | None:
        """The file that a frame's mask_path names; None without one, and where it is not there."""
        mask = frame.get("mask_path")
        if not mask:
            return None
        if not isinstance(mask, str):
            raise self._refusal(f"the mask_path of {name} is not a file name")
        named = relative_name(self._folder, mask)
        # Masks that are found by name lie beside the folder of images, too (`find_masks`), which may be what was given.
        beside = self._folder in self._root.parents and PurePosixPath(named).parts[:1] == (MASKS_FOLDER,)
        root = self._folder / MASKS_FOLDER if beside else self._root
        path = resolve_inside(self._folder, named, where=self._file, root=root)
        if is_file(path):
            return path
        self._without_masks.append(name)
        return None

    def _pose(self, frame: dict[str, Any], name: str) -> tuple[np.ndarray, bool]:
        try:
            matrix = np.array(frame["transform_matrix"], np.float64)
        except (KeyError, TypeError, ValueError, OverflowError):
            raise self._refusal(f"the transform_matrix of {name} is missing or not numbers") from None
        camera_to_world, repaired = rigid_pose(matrix, frame=name, where=self._file)
        return invert_rigid(camera_to_world @ OPENGL_TO_OPENCV), repaired

    def _smear(self, frame: dict[str, Any], name: str) -> np.ndarray | None:
        if SMEAR_KEY not in frame:
            return None
        try:
            line = np.array(frame[SMEAR_KEY], np.float64)
        except (TypeError, ValueError, OverflowError):
            line = np.zeros(0)
        if line.shape != (2,) or not (np.abs(line) < LARGEST_NUMBER).all():
            raise self._refusal(f"the {SMEAR_KEY} of {name} is not two numbers")
        return line

    def _number(self, frame: dict[str, Any], key: str, default: float) -> float:
        """`key` of the frame, else of the file, else `default`."""
        value = self._optional(frame, key)
        return default if value is None else value

    def _optional(self, frame: dict[str, Any], key: str) -> float | None:
        value = frame.get(key, self._document.get(key))
        if value is None:
            return None
        # An integer of a thousand digits is no float.
        usable = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST_NUMBER
        if not usable:
            raise self._refusal(f"{key} is {str(value)[:20]!r}, not a usable number")
        return float(value)

    def _camera(self, frame: dict[str, Any], name: str, path: Path) -> tuple[pycolmap.Camera, bool]:
        """Intrinsics of a frame, shared by frames that state the same, and whether the file states the image size."""
        width, height = self._optional(frame, "w"), self._optional(frame, "h")
        size_known = width is not None and height is not None
        if width is None or height is None:
            width, height = read_header(path).upright_size
        if not (1.0 <= width <= _MAX_STATED_SIDE and 1.0 <= height <= _MAX_STATED_SIDE):
            raise self._refusal(f"the image size {width:g} x {height:g} is unusable")
        focal_x, focal_y = self._focal_lengths(frame, name, width, height)
        center = (self._number(frame, "cx", width / 2), self._number(frame, "cy", height / 2))
        model, distortion = self._distortion(frame)
        description = (model, int(width), int(height), (focal_x, focal_y, *center, *distortion))
        if description not in self._cameras:
            camera = pycolmap.Camera(model=model, width=description[1], height=description[2], params=description[3])
            check_camera(camera, frame=f"the camera of {name}", where=self._file)
            self._cameras[description] = camera
        return self._cameras[description], size_known

    def _focal_lengths(self, frame: dict[str, Any], name: str, width: float, height: float) -> tuple[float, float]:
        """In pixels; from ``fl_x`` and ``fl_y``, else from the fields of view. One of them alone stands for both."""
        focal_x = self._optional(frame, "fl_x") or _focal_from_angle(self._optional(frame, "camera_angle_x"), width)
        focal_y = self._optional(frame, "fl_y") or _focal_from_angle(self._optional(frame, "camera_angle_y"), height)
        focal_x, focal_y = focal_x or focal_y, focal_y or focal_x
        if focal_x is None or focal_y is None:
            raise self._refusal(f"{name} has no focal length", "add fl_x or camera_angle_x to the file")
        return focal_x, focal_y

    def _distortion(self, frame: dict[str, Any]) -> tuple[str, tuple[float, ...]]:
        """COLMAP's name of the camera model and its distortion parameters."""
        name = frame.get("camera_model", self._document.get("camera_model", ""))
        name = name.upper() if isinstance(name, str) else repr(name)
        if frame.get("is_fisheye", self._document.get("is_fisheye")):
            name = "OPENCV_FISHEYE"
        if name in _FISHEYE:
            return "OPENCV_FISHEYE", self._coefficients(frame, _KANNALA_BRANDT)
        if name not in _PERSPECTIVE:
            raise self._refusal(
                f"the camera_model {name} is not supported",
                "undistort the photographs, or export with OPENCV or OPENCV_FISHEYE",
            )
        distortion = self._coefficients(frame, _BROWN)
        if not any(distortion):
            return "PINHOLE", ()
        if not any(distortion[4:]):
            return "OPENCV", distortion[:4]
        if name != "FULL_OPENCV" and distortion[5] and not any(distortion[6:]):
            raise self._refusal(
                f"k4 of {name or 'OPENCV'} is not supported", "calibrate without k4, or undistort the photographs"
            )
        return "FULL_OPENCV", distortion

    def _coefficients(self, frame: dict[str, Any], keys: Sequence[str]) -> tuple[float, ...]:
        """The distortion parameters `keys`; 0 where the file says nothing of one."""
        listed = frame.get(_LIST, self._document.get(_LIST))
        if listed is None:
            return tuple(self._number(frame, key, 0.0) for key in keys)
        if not isinstance(listed, list) or len(listed) > len(_LISTED):
            raise self._refusal(f"{_LIST} is not a list of {', '.join(_LISTED)}")
        given = {**dict.fromkeys(keys, 0.0), **dict(zip(_LISTED, listed, strict=False))}
        return tuple(self._number(given, key, 0.0) for key in keys)

    def _add_points(self, model: SourceModel) -> None:
        name = self._document.get("ply_file_path")
        if name is None:
            return
        if not isinstance(name, str):
            raise self._refusal("ply_file_path is not a file name")
        folder = self._file.parent
        wanted = relative_name(folder, name)
        if PureWindowsPath(wanted).anchor:  # a path on the machine that wrote the file, from where all was copied
            wanted = PureWindowsPath(wanted).name or wanted
        path = resolve_inside(folder, wanted, where=self._file)
        if not is_file(path):
            model.warn("missing-points", f"{self._file}: the point file {name} is missing")
            return
        model.points, model.point_colors = read_point_cloud(path)


def _focal_from_angle(angle: float | None, size: float) -> float | None:
    """Focal length in pixels of a field of view in radians across `size` pixels."""
    return size / (2.0 * math.tan(angle / 2.0)) if angle is not None and 0.0 < angle < math.pi else None
