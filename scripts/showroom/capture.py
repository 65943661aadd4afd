"""From settings to a capture folder: JPEG images, depth maps, points.ply, and transforms.json last. bpy and numpy."""

from __future__ import annotations

import json
import re
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.intake.sampling import evenly_spread
from ...core.runtime.protocol import Reporter
from ...core.settings import Settings
from . import photograph, room, scene
from .cameras import Pose, focal_pixels, rings, walk
from .settings import CameraSettings, CaptureSettings

DEPTH_UNIT = 2e-4
"""Metres a grey level of the 16-bit depth maps; they reach 13.1 m. 0 stands for no surface, or farther."""

SECOND_FOLDER = "images_again"
"""As in core.capture.views, which Blender's Python cannot import."""

_TRANSFORMS = "transforms.json"
_IMAGE_NAME = re.compile(r"view_\d{3,}\.jpg")
_START_OF_SCAN, _COMMENT = 0xDA, 0xFE  # JPEG markers


def make(out: Path, settings: CaptureSettings, reporter: Reporter, threads: int = 0) -> None:
    """Write a capture of the showroom into `out`; an interrupted one has no transforms.json.

    Raises:
        InputError: the folder contains other files, or cannot be written.
    """
    images, again, depths = _prepare(out)
    build, route = (room.build, walk) if settings.scene.scene == "room" else (scene.build, rings)
    build(settings.scene, settings.seed, lambda message: reporter.status("set", message))
    camera = photograph.set_up_camera(settings.cameras)
    photograph.set_up_render(settings, threads)
    poses = route(settings.cameras)

    reporter.status("photographs", f"{len(poses)} views of {settings.cameras.width} x {settings.cameras.height}")
    paths = []
    for index, pose in enumerate(poses):
        paths.append(images / f"{pose.name}.jpg")
        photograph.render_view(camera, pose, paths[-1])
        _drop_comments(paths[-1])
        reporter.progress("photographs", (index + 1) / len(poses), paths[-1].name)

    second = _held_out(poses)
    reporter.status("second photographs", f"{len(second)} of the held-out views, with other noise")
    photograph.set_up_render(replace(settings, seed=settings.seed + 1), threads)
    for index, pose in enumerate(second):
        path = again / f"{pose.name}.jpg"
        photograph.render_view(camera, pose, path)
        _drop_comments(path)
        reporter.progress("second photographs", (index + 1) / len(second), path.name)

    measured = evenly_spread(poses, settings.depth_views)
    reporter.status("depth", f"{len(measured)} maps and {settings.points} points")
    surfaces = photograph.Surfaces()
    for index, pose in enumerate(measured):
        _write_depth(depths / f"{pose.name}.png", surfaces.depth_map(pose, settings.cameras))
        reporter.progress("depth", (index + 1) / len(measured), pose.name)
    _write_depth_index(depths / "depth.json", [pose.name for pose in measured])
    _write_points(out / "points.ply", *photograph.sparse_points(surfaces, poses, paths, settings))
    _write_transforms(out / _TRANSFORMS, settings.cameras, poses)


def _held_out(poses: list[Pose]) -> list[Pose]:
    """The views that a run with the default settings holds out."""
    return poses[:: Settings.holdout]


def _prepare(out: Path) -> tuple[Path, Path, Path]:
    """Create the folders for images, second images and depth maps, without an earlier showroom's files."""
    images, again, depths = out / "images", out / SECOND_FOLDER, out / "depth"
    try:
        if out.exists() and any(out.iterdir()) and not _is_showroom(images):
            raise InputError("the folder contains other files", where=out, remedy="give an empty or new folder")
        (out / _TRANSFORMS).unlink(missing_ok=True)
        for folder, pattern in ((images, "view_*.jpg"), (again, "view_*.jpg"), (depths, "view_*.png")):
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.glob(pattern):
                old.unlink()
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", where=out, remedy="choose another folder") from None
    return images, again, depths


def _is_showroom(images: Path) -> bool:
    """Whether an image folder is there and holds nothing that this program would not have written."""
    return images.is_dir() and all(_IMAGE_NAME.fullmatch(path.name) for path in images.iterdir())


def _write_transforms(path: Path, settings: CameraSettings, poses: list[Pose]) -> None:
    """transforms.json as nerfstudio reads it: OpenGL camera-to-world, pixel intrinsics, the points beside it."""
    focal = focal_pixels(settings)
    document = {
        "camera_model": "PINHOLE",
        "w": settings.width,
        "h": settings.height,
        "fl_x": focal,
        "fl_y": focal,
        "cx": settings.width / 2,
        "cy": settings.height / 2,
        "ply_file_path": "points.ply",
        "frames": [
            {"file_path": f"images/{pose.name}.jpg", "transform_matrix": pose.camera_to_world.tolist()}
            for pose in poses
        ],
    }
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _drop_comments(path: Path) -> None:
    """Remove the comment segments of a JPEG: Blender writes date and render times there, which differ every time."""
    data = path.read_bytes()
    kept, position = [data[:2]], 2
    # Segments before the image data: 0xFF, marker, 16-bit length that counts itself (ITU-T T.81, annex B).
    while (marker := data[position + 1]) != _START_OF_SCAN:
        end = position + 2 + int.from_bytes(data[position + 2 : position + 4], "big")
        if marker != _COMMENT:
            kept.append(data[position:end])
        position = end
    path.write_bytes(b"".join([*kept, data[position:]]))


def _write_points(path: Path, positions: NDArray[np.float32], colors: NDArray[np.uint8]) -> None:
    """Binary little-endian PLY of (P, 3) positions and (P, 3) sRGB colours."""
    properties = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    table = np.empty(len(positions), dtype=properties)
    for axis in range(3):
        table["xyz"[axis]] = positions[:, axis]
        table[("red", "green", "blue")[axis]] = colors[:, axis]
    kind = {"<f4": "float", "u1": "uchar"}
    lines = [f"property {kind[dtype]} {name}" for name, dtype in properties]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}", *lines, "end_header", ""]
    path.write_bytes("\n".join(header).encode("ascii") + table.tobytes())


def _write_depth(path: Path, depth: NDArray[np.floating]) -> None:
    """(H, W) metres as a 16-bit grey PNG in steps of `DEPTH_UNIT`."""
    levels = np.rint(np.where(np.isfinite(depth), depth, 0.0) / DEPTH_UNIT)
    _write_png16(path, np.where(levels < 65536, levels, 0).astype(np.uint16))


def _write_depth_index(path: Path, names: list[str]) -> None:
    """Says what the depth maps beside it mean."""
    document = {
        "kind": "planar camera z at the pixel centres, of the first surface (organza included); 0 = none or too far",
        "metres_per_unit": DEPTH_UNIT,
        "frames": {f"images/{name}.jpg": f"depth/{name}.png" for name in names},
    }
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _write_png16(path: Path, values: NDArray[np.uint16]) -> None:
    """A grey 16-bit PNG whose rows are stored as differences from the row above (filter type 2, ISO/IEC 15948)."""
    height, width = values.shape
    octets = values.astype(">u2").view(np.uint8).reshape(height, width * 2)
    above = np.vstack([np.zeros_like(octets[:1]), octets[:-1]])
    rows = np.concatenate([np.full((height, 1), 2, np.uint8), octets - above], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
