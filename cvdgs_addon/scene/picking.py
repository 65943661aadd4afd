"""Where a ray meets the surface that Gaussians show, so that somebody can click on it, in whatever form it is drawn."""

from __future__ import annotations

import bpy
import mathutils
import numpy as np

from .crop import left_by_crop
from .shapes import frame_map, rotation_matrices
from .splat_attributes import Attribute, is_gaussian, read_attribute, vertex_positions

_REACH = 4.0  # standard deviations beyond which a Gaussian is not met
_LEAST_OPACITY = 1.0 / 255.0
_HALF = 0.5  # of the light that still passes, where the surface is


def surface_point(
    splats: bpy.types.Object, origin: mathutils.Vector, direction: mathutils.Vector
) -> mathutils.Vector | None:
    """The place in the scene at which Gaussians have taken half of the light of a ray; None where they never do.

    A Gaussian counts where the ray comes closest to its centre in units of its standard deviations, as in a render.

    Args:
        splats: in Object Mode; removed and cropped Gaussians are not met.
        origin: of the ray, in the scene.
        direction: of the ray, of any length.
    """
    mesh = splats.data
    into = splats.matrix_world.inverted_safe()
    start = np.array(into @ origin, np.float64)
    along = np.array(into.to_3x3() @ direction, np.float64)
    positions = vertex_positions(mesh)
    there = is_gaussian(mesh) & left_by_crop(splats, positions)
    if Attribute.REMOVED in mesh.attributes:
        there &= ~read_attribute(mesh, Attribute.REMOVED)
    shape = frame_map(mesh)
    scales = read_attribute(mesh, Attribute.SCALE).astype(np.float64)
    offsets = positions.astype(np.float64) - start
    across = np.linalg.norm(np.cross(offsets, along), axis=1) / np.linalg.norm(along)
    near = there & (across <= _REACH * scales.max(axis=1) * np.linalg.norm(shape, 2))
    if not near.any():
        return None
    axes = shape @ (rotation_matrices(read_attribute(mesh, Attribute.ROTATION)[near]) * scales[near][:, None, :])
    whitened = np.linalg.inv(axes)
    to_center, step = (whitened @ offsets[near][:, :, None])[:, :, 0], whitened @ along
    depth = (to_center * step).sum(axis=1) / (step * step).sum(axis=1)
    distance = ((to_center - depth[:, None] * step) ** 2).sum(axis=1)
    opacity = read_attribute(mesh, Attribute.OPACITY)[near] * np.exp(-0.5 * distance)
    met = (depth > 0.0) & (opacity >= _LEAST_OPACITY)
    order = np.argsort(depth[met])
    light = np.cumprod(1.0 - opacity[met][order])
    behind = np.flatnonzero(light <= _HALF)
    if not len(behind):
        return None
    return origin + float(depth[met][order][behind[0]]) * direction
