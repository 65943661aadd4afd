"""The files of a COLMAP model, in both their forms: cameras, posed images and points, and how bad ones are refused.

The binary form is read record by record and the text form line by line. pycolmap's own readers take whatever a file
claims, so a damaged or hostile one could end the process or fill the memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import InputError
from ..files.untrusted import is_file, is_there
from ..runtime.protocol import Reporter
from .colmap_binary import binary_cameras, binary_images, binary_points
from .colmap_records import EXPORT_AGAIN, ColmapImage, require
from .colmap_text import text_cameras, text_images, text_points
from .source import MOST_VIEWS


@dataclass
class ColmapModel:
    """What a model says.

    Attributes:
        cameras: by their numbers.
        images: in the file's order; their cameras are there.
        points: (P, 3) float32 positions of those that can be trusted (`Points.are_trusted`), and `point_colors` (P, 3)
            uint8.
        point_numbers: (P,) uint64, by which observations name points.
    """

    cameras: dict[int, pycolmap.Camera] = field(default_factory=dict)
    images: list[ColmapImage] = field(default_factory=list)
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    point_colors: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    point_numbers: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(0, np.uint64))


def read_model(folder: Path, reporter: Reporter | None = None, *, observed: bool = False) -> ColmapModel:
    """The model in `folder`, binary if it has both forms whole; without points where it has no file of them.

    Args:
        reporter: told how far the points are read.
        observed: read also which points the images see, and where.

    Raises:
        InputError: the cameras or the images are missing, or a file is cut or damaged.
    """
    forms = [[folder / (name + suffix) for name in ("cameras", "images", "points3D")] for suffix in (".bin", ".txt")]
    whole = [form for form in forms if all(map(is_file, form))]
    # Of a model that is incomplete in both forms, the message is about the form of which more is there.
    most = forms[0] if is_file(forms[0][1]) else max(reversed(forms), key=lambda form: sum(map(is_file, form)))
    cameras, images, points = whole[0] if whole else most
    for path in (cameras, images):
        if not is_file(path):
            remedy = f"{EXPORT_AGAIN}, or add --cameras estimate"
            raise InputError(f"{path.name} is missing", where=folder, remedy=remedy)
    binary = cameras.suffix == ".bin"
    model = ColmapModel()
    for number, camera in (binary_cameras if binary else text_cameras)(cameras):
        require(number not in model.cameras, f"two cameras have the number {number}", cameras)
        require(len(model.cameras) < MOST_VIEWS, f"the model has more than {MOST_VIEWS:,} cameras", cameras)
        model.cameras[number] = camera
    for image in (binary_images if binary else text_images)(images, observed=observed):
        known = image.camera_id in model.cameras
        require(known, f"damaged: {image.name} refers to camera {image.camera_id}, which is missing", images)
        require(len(model.images) < MOST_VIEWS, f"the model has more than {MOST_VIEWS:,} images", images)
        model.images.append(image)
    if not is_there(points):
        return model
    read = (binary_points if binary else text_points)(points, reporter or Reporter())
    model.points = np.frombuffer(read.positions, np.float32).reshape(-1, 3)
    model.point_colors = np.frombuffer(read.colors, np.uint8).reshape(-1, 3)
    model.point_numbers = np.frombuffer(read.numbers, np.uint64)
    trusted = read.are_trusted()
    if not trusted.all():  # else there is no need for copies, of tens of millions of points in the worst case
        model.points, model.point_colors = model.points[trusted], model.point_colors[trusted]
        model.point_numbers = model.point_numbers[trusted]
    return model
