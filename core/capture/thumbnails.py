"""Small pictures of a capture's first photographs, for a front end to show."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from ..images import write_png
from .images import downscale_with_alpha, fit_size, read_pixels
from .locate import photographs_without_cameras, read_cameras
from .views import plan_views


def write_thumbnails(capture: Path, folder: Path, *, count: int, size: int, sfm: bool = False) -> list[Path]:
    """Write PNG files of the first `count` photographs, `size` pixels the longer side; returns their paths.

    Args:
        capture: as for `read_capture`.
        folder: where to; made when it is missing.
        sfm: accept photographs without cameras.

    Raises:
        InputError: as `read_capture`.
        OSError: the folder cannot be written.
    """
    paths = []
    for number, (photograph, upright) in enumerate(islice(_photographs(capture, sfm), count)):
        image, alpha = read_pixels(photograph, upright=upright)
        width, height = fit_size(image.shape[1], image.shape[0], size)
        image, alpha = downscale_with_alpha(image, alpha, width, height)
        paths.append(folder / f"{number}.png")
        write_png(paths[-1], image, alpha)
    return paths


def _photographs(capture: Path, sfm: bool) -> list[tuple[Path, bool]]:
    """Every photograph, and whether its EXIF orientation is applied."""
    model = read_cameras(capture)
    if model is None:
        folder, names = photographs_without_cameras(capture, sfm=sfm)
        return [(folder / name, True) for name in names]
    return [(plan.source.path, plan.upright) for plan in plan_views(model, max_size=None)]
