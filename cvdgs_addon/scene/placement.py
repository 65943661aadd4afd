"""Where a capture stands in a Blender scene: upright, of sensible size, undone by clearing one Empty's transform."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from .finished_run import RunView

EMPTY_NAME = "Capture"

# A capture whose +Z is within this angle of up is taken to be upright already, and stays as it is.
_UPRIGHT_TOLERANCE = np.radians(25.0)
NEAR = 0.05  # of the rasteriser (`core.splats.raster.camera`), in the trainer's units
# Distances from camera to subject that suit Blender's units, grid and clipping, and what another one is scaled to.
_COMFORTABLE_DISTANCE = (0.3, 30.0)  # metres
_DISTANCE = 3.0  # metres


def placement(views: Sequence[RunView], center: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) similarity from the capture's world to Blender's, the identity where that suits already.

    Structure from motion has neither up nor size. Photographers hold a camera upright, so that the mean of the
    cameras' up directions is up; the subject's distance becomes a few metres, and its centre the origin.

    Args:
        views: the cameras.
        center: (3,) of the subject.
    """
    poses = np.stack([view.camera_to_world for view in views])
    up = poses[:, :3, 1].mean(axis=0)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 1e-6 else np.array([0.0, 0.0, 1.0])
    distance = camera_distance(views, center)
    upright = np.arccos(np.clip(up[2], -1.0, 1.0)) <= _UPRIGHT_TOLERANCE
    low, high = _COMFORTABLE_DISTANCE
    if upright and low <= distance <= high:
        return np.eye(4)
    scale = 1.0 if low <= distance <= high else _DISTANCE / distance
    rotation = np.eye(3) if upright else np.array(mathutils.Vector(up).rotation_difference((0.0, 0.0, 1.0)).to_matrix())
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation
    matrix[:3, 3] = -scale * rotation @ center
    return matrix


def camera_distance(views: Sequence[RunView], center: NDArray[np.float64]) -> float:
    """Median distance of the cameras from `center`, never zero."""
    positions = np.stack([view.camera_to_world[:3, 3] for view in views])
    return max(float(np.median(np.linalg.norm(positions - center, axis=1))), 1e-6)


def near_depth(views: Sequence[RunView], distance: float) -> float:
    """Smallest depth that was drawn in training, in the capture's units.

    The trainer's unit is the farthest camera's distance from their mean position (`core.splats.scene_frame`).

    Args:
        views: the cameras.
        distance: of the cameras from the subject, which stands in where they all share one centre.
    """
    positions = np.stack([view.camera_to_world[:3, 3] for view in views])
    extent = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max())
    return NEAR * (extent if extent > 1e-6 * distance else distance)


def add_empty(matrix: NDArray[np.float64], size: float, collection: bpy.types.Collection) -> bpy.types.Object:
    """The Empty that carries cameras and Gaussians, its axes `size` scene units long."""
    empty = bpy.data.objects.new(EMPTY_NAME, None)
    empty.empty_display_type = "ARROWS"
    empty.empty_display_size = size
    empty.rotation_mode = "QUATERNION"
    empty.matrix_basis = mathutils.Matrix(matrix.tolist())
    collection.objects.link(empty)
    return empty
