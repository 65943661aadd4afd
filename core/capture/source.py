"""What the readers of camera files hand on: cameras as the file states them, before any pixel is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..errors import InputError, one_line
from .files import quote_first
from .model import CaptureWarning, Estimate

SMEAR_KEY = "motion_blur"
"""Of a frame in our camera files: `View.smear`."""
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
        time: seconds into the video that it is a frame of.
        mask: the image file of its mask, which exists.
        smear: as in `View`, in pixels of the camera's image.
        again: the image file of a second photograph from the same place, which exists.
    """

    name: str
    path: Path
    camera: pycolmap.Camera
    world_to_camera: NDArray[np.float64]
    size_known: bool = True
    estimated: bool = False
    time: float | None = None
    mask: Path | None = None
    smear: NDArray[np.float64] | None = None
    again: Path | None = None


@dataclass
class SourceModel:
    """Everything a camera file says.

    Attributes:
        format: "colmap", "transforms" or "sfm".
        file: the file or folder it was read from, for messages.
        views: those whose image file exists.
        points: (P, 3) float32 and `point_colors` (P, 3) uint8 sRGB, in the frame of the views.
        estimate: of cameras that were estimated.
    """

    format: str
    file: Path
    views: list[SourceView]
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    point_colors: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    warnings: list[CaptureWarning] = field(default_factory=list)
    estimate: Estimate | None = None

    def warn(self, name: str, message: str) -> None:
        """Note something that does not stop the run."""
        self.warnings.append(CaptureWarning(name, one_line(message)))

    def warn_about_views(self, missing: Sequence[str], skewed: Sequence[str], count: int, folder: Path) -> None:
        """Note which of `count` images are missing in `folder`, and whose rotations `rigid_pose` had to correct."""
        if missing:
            what = f"{len(missing)} of {count} images are missing in {folder} and left out"
            self.warn("missing-images", f"{self.file}: {what}: {quote_first(missing)}")
        if skewed:
            self.warn(
                "reorthonormalised", f"{self.file}: slightly skewed rotations are corrected: {quote_first(skewed)}"
            )


# Files written with six digits stay below the first; hand-edited or single-precision chains below the second.
_ORTHONORMAL = 1e-5
_REPAIRABLE = 1e-2
# Products of such numbers still fit a float64, and a scene of this size does not fit float32 points any more.
LARGEST_NUMBER = 1e30
# Camera (x right, y up, z back; OpenGL, Blender) to camera (x right, y down, z forward; OpenCV).
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def rigid_pose(matrix: NDArray[np.float64], *, frame: str, where: str | Path) -> tuple[NDArray[np.float64], bool]:
    """The rigid transform that a (3, 4) or (4, 4) pose means.

    A uniform scale of the axes, which instant-ngp's tools sometimes leave in, is divided out; axes that are off by less
    than 1e-2 are made orthonormal with the nearest rotation (polar decomposition).

    Returns:
        (4, 4) float64, and whether the axes had to be made orthonormal.

    Raises:
        InputError: not finite, of another shape, a reflection, or too far from a rotation.
    """

    def refusal(what: str) -> InputError:
        return InputError(what, where=where, remedy="export the cameras again or remove this frame")

    if matrix.shape not in ((3, 4), (4, 4)):
        raise refusal(f"the pose of {frame} has the shape {matrix.shape}, not 4 x 4")
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > LARGEST_NUMBER:
        raise refusal(f"the pose of {frame} holds NaN, infinite or huge numbers")
    if matrix.shape == (4, 4) and not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0], atol=1e-6):
        raise refusal(f"the last row of the pose of {frame} is not 0 0 0 1")
    axes = matrix[:3, :3]
    determinant = np.linalg.det(axes)
    scale = np.cbrt(abs(determinant))
    error = np.abs(axes.T @ axes / scale**2 - np.eye(3)).max() if scale > 1e-12 else np.inf
    if error > _REPAIRABLE:
        raise refusal(f"the rotation of {frame} is skewed: not orthonormal by {error:.2g}")
    if determinant < 0.0:
        raise refusal(f"the rotation of {frame} is a reflection")
    pose = np.eye(4)
    pose[:3, 3] = matrix[:3, 3]
    scaled = abs(scale - 1.0) > _ORTHONORMAL
    if scaled or error > _ORTHONORMAL:
        left, _, right = np.linalg.svd(axes)
        pose[:3, :3] = left @ right
    else:
        pose[:3, :3] = axes
    return pose, error > _ORTHONORMAL


def invert_rigid(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of a (4, 4) rigid transform, without the rounding of a general inverse."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse
