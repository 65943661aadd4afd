"""What the readers of camera files hand on: cameras as the file states them, before any pixel is read."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import one_line
from .model import CaptureWarning

# Of a capture; all views are in memory together, and 20,000 of one megapixel have 60 GB.
MOST_VIEWS = 20_000


@dataclass(frozen=True)
class SourceView:
    """One photograph as a camera file describes it.

    Attributes:
        name: the image's name in the camera file.
        path: the image file, which exists.
        camera: intrinsics with distortion, at the size the camera file states. Views may share one.
        world_to_camera: (4, 4) float64, rigid, OpenCV axes.
        size_known: False where the camera file gives no image size; then `camera` has the upright size of the image.
        estimated: `camera` was estimated from the image as it is stored. The view is turned upright with its camera.
    """

    name: str
    path: Path
    camera: pycolmap.Camera
    world_to_camera: NDArray[np.float64]
    size_known: bool = True
    estimated: bool = False


@dataclass
class SourceModel:
    """Everything a camera file says.

    Attributes:
        format: "colmap", "transforms" or "sfm".
        file: the file or folder it was read from, for messages.
        views: those whose image file exists.
        points: (P, 3) float32 and `point_colors` (P, 3) uint8 sRGB, in the frame of the views.
    """

    format: str
    file: Path
    views: list[SourceView]
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    point_colors: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    warnings: list[CaptureWarning] = field(default_factory=list)

    def warn(self, name: str, message: str) -> None:
        """Note something that does not stop the run."""
        self.warnings.append(CaptureWarning(name, one_line(message)))
