"""From settings to a capture folder: build the set, photograph it, write the cameras last. bpy and numpy."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...core.errors import InputError
from ...core.runtime.protocol import Reporter
from . import capture, photograph, scene
from .cameras import rings
from .settings import CaptureSettings

TRANSFORMS = "transforms.json"
IMAGE_NAME = re.compile(r"view_\d{3,}\.jpg")


def make(out: Path, settings: CaptureSettings, reporter: Reporter, threads: int = 0) -> None:
    """Write a capture of the showroom into `out`; an interrupted one has no transforms.json.

    Raises:
        InputError: the folder holds something else, or cannot be written.
    """
    images, depths = _prepare(out)
    scene.build(settings.scene, settings.seed, lambda message: reporter.status("set", message))
    camera = photograph.set_up_camera(settings.cameras)
    photograph.set_up_render(settings, threads)
    poses = rings(settings.cameras)

    reporter.status("photographs", f"{len(poses)} views of {settings.cameras.width} x {settings.cameras.height}")
    paths = []
    for index, pose in enumerate(poses):
        paths.append(images / f"{pose.name}.jpg")
        photograph.render_view(camera, pose, paths[-1])
        capture.drop_comments(paths[-1])
        reporter.progress("photographs", (index + 1) / len(poses), paths[-1].name)

    chosen = np.linspace(0, len(poses) - 1, min(settings.depth_views, len(poses))).round().astype(int)
    reporter.status("depth", f"{len(chosen)} maps and {settings.points} points")
    surfaces = photograph.Surfaces()
    measured = [poses[index] for index in chosen]
    for index, pose in enumerate(measured):
        capture.write_depth(depths / f"{pose.name}.png", surfaces.depth_map(pose, settings.cameras))
        reporter.progress("depth", (index + 1) / len(measured), pose.name)
    capture.write_depth_index(depths / "depth.json", [pose.name for pose in measured])
    capture.write_points(out / "points.ply", *photograph.sparse_points(surfaces, poses, paths, settings))
    capture.write_transforms(out / TRANSFORMS, settings.cameras, poses)


def _prepare(out: Path) -> tuple[Path, Path]:
    """Create the folders for images and depth maps, without an earlier showroom's files."""
    images, depths = out / "images", out / "depth"
    try:
        if out.exists() and any(out.iterdir()) and not _is_showroom(images):
            raise InputError("the folder holds something else", where=out, remedy="give an empty or new folder")
        (out / TRANSFORMS).unlink(missing_ok=True)
        for folder, pattern in ((images, "view_*.jpg"), (depths, "view_*.png")):
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.glob(pattern):
                old.unlink()
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror})", where=out, remedy="choose another folder") from None
    return images, depths


def _is_showroom(images: Path) -> bool:
    """Whether an image folder is there and holds nothing that this program would not have written."""
    return images.is_dir() and all(IMAGE_NAME.fullmatch(path.name) for path in images.iterdir())
