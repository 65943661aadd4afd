"""Checks that a camera file's matrix is a rigid pose, and small repairs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

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
    remedy = "export the cameras again or remove this frame"
    if matrix.shape not in ((3, 4), (4, 4)):
        raise InputError(f"the pose of {frame} has the shape {matrix.shape}, not 4 x 4", where=where, remedy=remedy)
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > LARGEST_NUMBER:
        raise InputError(f"the pose of {frame} holds NaN, infinite or huge numbers", where=where, remedy=remedy)
    if matrix.shape == (4, 4) and not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0], atol=1e-6):
        raise InputError(f"the last row of the pose of {frame} is not 0 0 0 1", where=where, remedy=remedy)
    axes = matrix[:3, :3]
    determinant = np.linalg.det(axes)
    scale = np.cbrt(abs(determinant))
    error = np.abs(axes.T @ axes / scale**2 - np.eye(3)).max() if scale > 1e-12 else np.inf
    if error > _REPAIRABLE:
        raise InputError(
            f"the rotation of {frame} is skewed: not orthonormal by {error:.2g}", where=where, remedy=remedy
        )
    if determinant < 0.0:
        raise InputError(f"the rotation of {frame} is a reflection", where=where, remedy=remedy)
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
