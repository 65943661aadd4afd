"""Where an object stands in its scene, also where Blender has not looked."""

from __future__ import annotations

import bpy
import mathutils

from .view_layers import collections_in

# With these the parent's own matrix does not tell where its child is.
_PARTS_OF_PARENTS = {"BONE", "VERTEX", "VERTEX_3"}


def world_of(target: bpy.types.Object) -> mathutils.Matrix:
    """The 4 × 4 matrix from the space of `target` to its scene's.

    Blender keeps ``matrix_world`` up to date only for what the open scene evaluates, not for what the monitor icon
    hides or an excluded collection has: there it is an old one, and the identity in a file that was just opened. Their
    place follows from their parents; constraints do not count then.
    """
    if target.parent_type in _PARTS_OF_PARENTS or is_evaluated(target):
        return target.matrix_world.copy()
    if target.parent is None:
        return target.matrix_basis.copy()
    return world_of(target.parent) @ target.matrix_parent_inverse @ target.matrix_basis


def scale_of(matrix: mathutils.Matrix) -> float:
    """The factor by which a 4 × 4 matrix enlarges along the axis that it enlarges most, also where it mirrors."""
    return max(map(abs, matrix.to_scale()))  # Blender gives a mirroring matrix negative ones


def is_evaluated(target: bpy.types.Object) -> bool:
    """Whether the open view layer keeps the object up to date; the key H and the eye icon do not keep it from that.

    Its copy in the dependency graph does not tell: what a property of the scene points to has one, with an old matrix.
    """
    shown = collections_in(bpy.context.view_layer.layer_collection, hidden_by="hide_viewport")
    return not target.hide_viewport and any(found.objects.get(target.name) == target for found in shown)
