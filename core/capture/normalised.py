"""The normalised form of a capture: pinhole transforms.json, PNG images and PLY points, which any program can read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..files.images import write_png
from ..files.untrusted import replacing
from ..runs.layout import CAMERAS_FILE, IMAGES_FOLDER, MASKS_FOLDER, POINTS_FILE
from .model import Capture, View
from .points import write_point_cloud
from .source import OPENGL_TO_OPENCV, SMEAR_KEY, invert_rigid


def write_capture(capture: Capture, folder: str | Path) -> None:
    """Write a capture so that `read_capture` gives the same cameras, pixels and points.

    ``transforms.json`` follows nerfstudio's convention (camera-to-world, OpenGL axes, intrinsics in every frame),
    and gives frames of videos their time in seconds; it is written last, so a folder that has it is complete.

    Raises:
        OSError: the folder cannot be written.
    """
    folder = Path(folder)
    (folder / IMAGES_FOLDER).mkdir(parents=True, exist_ok=True)
    for view in capture.views:
        write_png(folder / _image_name(view), view.image, view.alpha)
        write_mask(view, folder)
    write_cameras(capture, folder)


def write_mask(view: View, folder: Path) -> None:
    """Write the mask of a view, if it has one, where `write_capture` writes it.

    Raises:
        OSError: the folder cannot be written.
    """
    if view.mask is not None:
        pixels = np.where(view.mask, 255, 0).astype(np.uint8)
        write_png(folder / _mask_name(view), np.repeat(pixels[..., None], 3, axis=2))


def write_cameras(capture: Capture, folder: Path) -> None:
    """Write the cameras and the sparse points, where `write_capture` has written the rest.

    Raises:
        OSError: the folder cannot be written.
    """
    document: dict[str, Any] = {"camera_model": "PINHOLE", "frames": [_frame(view) for view in capture.views]}
    if len(capture.points):
        write_point_cloud(folder / POINTS_FILE, capture.points, capture.point_colors)
        document["ply_file_path"] = POINTS_FILE
    if capture.up:
        document["up"] = capture.up.direction.tolist()
    if capture.metres_per_unit:
        document["metres_per_unit"] = capture.metres_per_unit
    with replacing(folder / CAMERAS_FILE) as temporary:
        temporary.write_text(json.dumps(document, indent=1, allow_nan=False), encoding="utf-8")


def _image_name(view: View) -> str:
    return f"{IMAGES_FOLDER}/{view.key}.png"


def _mask_name(view: View) -> str:
    return f"{MASKS_FOLDER}/{view.key}.png"


def _frame(view: View) -> dict[str, Any]:
    camera = view.camera
    camera_to_world = invert_rigid(view.world_to_camera) @ OPENGL_TO_OPENCV
    time = {} if view.time is None else {"time": view.time}
    mask = {} if view.mask is None else {"mask_path": _mask_name(view)}
    smear = {} if view.smear is None else {SMEAR_KEY: view.smear.tolist()}
    return {
        "file_path": _image_name(view),
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "transform_matrix": camera_to_world.tolist(),
        **time,
        **mask,
        **smear,
    }
