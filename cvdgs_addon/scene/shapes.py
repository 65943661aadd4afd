"""Shapes of Gaussians as matrices: rotations, covariances, and the map that their mesh went through. No nodes."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from .cameras import is_capture_camera
from .splat_attributes import (
    Attribute,
    Frame,
    is_gaussian,
    point_positions,
    read_attribute,
    refuse_joined,
    vertex_positions,
)


def rotation_matrices(quaternions: NDArray) -> NDArray[np.float64]:
    """(N, 3, 3) of (N, 4) quaternions of any length, wxyz; the columns are the local axes."""
    quaternions = quaternions.astype(np.float64)
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], 1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], 1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], 1),
        ],
        axis=1,
    )


def covariances(mesh: bpy.types.Mesh) -> NDArray[np.float64]:
    """(N, 3, 3) of the Gaussians of `mesh`, as they were made."""
    mask = is_gaussian(mesh)
    axes = rotation_matrices(read_attribute(mesh, Attribute.ROTATION)[mask])
    axes = axes * read_attribute(mesh, Attribute.SCALE)[mask].astype(np.float64)[:, None, :]
    return np.asarray(axes @ axes.transpose(0, 2, 1))


def frame_map(mesh: bpy.types.Mesh) -> NDArray[np.float64]:
    """(3, 3) linear map that `mesh` went through since it was made (see `splat_attributes.Frame`).

    Raises:
        InputError: Blender's *Join* made it of several, which went through other maps.
    """
    refuse_joined(mesh)
    positions, frame = vertex_positions(mesh), read_attribute(mesh, Attribute.FRAME)
    points = {number: positions[frame == number].mean(axis=0) for number in Frame if (frame == number).any()}
    if len(points) < len(Frame):
        return np.eye(3)
    size = float(read_attribute(mesh, Attribute.SCALE)[frame == Frame.ORIGIN][0, 0])
    edges = [(points[axis] - points[Frame.ORIGIN]) / size for axis in (Frame.X, Frame.Y, Frame.Z)]
    return np.stack(edges, axis=1).astype(np.float64)


def towards_cameras(splats: bpy.types.Object) -> NDArray[np.float64]:
    """(N, 3) from each Gaussian to the middle of the photographs' cameras; outwards where there are none."""
    positions = point_positions(splats.data).astype(np.float64)
    cameras = [found for found in (splats.parent.children if splats.parent else ()) if is_capture_camera(found)]
    if not cameras:
        return np.asarray(positions - np.median(positions, axis=0))
    into = np.array((splats.matrix_parent_inverse @ splats.matrix_basis).inverted_safe())
    eyes = np.array([camera.matrix_basis.translation for camera in cameras], np.float64)
    middle = eyes.mean(axis=0) @ into[:3, :3].T + into[:3, 3]
    return np.asarray(middle - positions)
