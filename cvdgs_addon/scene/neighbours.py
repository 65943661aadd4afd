"""Several runs in one scene: which of their Gaussians stand in each other, and how to set them apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import bpy
import mathutils
import numpy as np

from .bystanders import hide
from .native_splats import native_splats_of
from .splat_attributes import Attribute, Frame, read_attribute
from .splats import is_splats
from .world_matrix import world_of

_GAP = 0.1  # between two sets, in radii of the one that is moved


class _Sphere(NamedTuple):
    """Where most of a set of Gaussians is, in the scene."""

    center: mathutils.Vector
    radius: float


def overlapping(scene: bpy.types.Scene, splats: bpy.types.Object) -> list[bpy.types.Object]:
    """The other Gaussians of `scene` that are visible and stand where most of `splats` do."""
    own = _sphere(splats)
    found = []
    for other in _others(scene, splats):
        sphere = _sphere(other)
        if own and sphere and (own.center - sphere.center).length < own.radius + sphere.radius:
            found.append(other)
    return found


def partner_of(
    scene: bpy.types.Scene, splats: bpy.types.Object, chosen: bpy.types.Object | None
) -> bpy.types.Object | None:
    """The Gaussians that `splats` are brought together with: the chosen ones, else the first visible others."""
    others = _others(scene, splats)
    return chosen if chosen in others else next(iter(others), None)


def hide_others(scene: bpy.types.Scene, splats: bpy.types.Object) -> list[str]:
    """Hide all other Gaussians, in 3D views as the key H does and in renders; returns their names."""
    others = _others(scene, splats)
    hide_gaussians(scene, others)
    return [other.name for other in others]


def hide_gaussians(scene: bpy.types.Scene, hidden: Sequence[bpy.types.Object]) -> None:
    """Hide Gaussians, and Blender's own splats that were made of them."""
    copies = filter(None, map(native_splats_of, hidden))
    hide(scene, [found.name for found in (*hidden, *copies)])


def place_beside(scene: bpy.types.Scene, splats: bpy.types.Object) -> None:
    """Move `splats` along +X until they are clear of all others, with their capture where it is theirs alone."""
    bpy.context.view_layer.update()
    own, others = _sphere(splats), _others(scene, splats)
    spheres = list(filter(None, map(_sphere, others)))
    if own is None or not spheres:
        return
    end = max(sphere.center.x + sphere.radius for sphere in spheres)
    shift = mathutils.Vector((end + (1.0 + _GAP) * own.radius - own.center.x, 0.0, 0.0))
    is_shared = any(other.parent == splats.parent for other in others)  # by a duplicate, which would move along
    root = splats if is_shared or splats.parent is None else splats.parent
    root.matrix_world = mathutils.Matrix.Translation(shift) @ world_of(root)


def _others(scene: bpy.types.Scene, splats: bpy.types.Object) -> list[bpy.types.Object]:
    # What is in no view layer, because its collection is excluded, is not seen and cannot be hidden.
    return [
        other
        for other in scene.objects
        if is_splats(other)
        and other != splats
        and not (other.hide_render or other.hide_get())
        and any(layer.objects.get(other.name) == other for layer in scene.view_layers)
    ]


def _sphere(splats: bpy.types.Object) -> _Sphere | None:
    """By the frame's points, which remember the core; None where somebody has deleted them.

    A panel asks at every redraw, so it looks at all points only where some were added behind the frame's.
    """
    mesh = splats.data
    numbers, vertices = mesh.attributes.get(Attribute.FRAME), mesh.vertices
    first = len(vertices) - len(Frame)
    if splats.mode == "EDIT" or numbers is None or first < 0:
        return None
    indices: Sequence[int] = range(first, len(vertices))
    if any(numbers.data[index].value == 0 for index in indices):
        indices = np.flatnonzero(read_attribute(mesh, Attribute.FRAME)).tolist()
    places = {numbers.data[index].value: vertices[index].co for index in indices}
    if set(places) != set(Frame):
        return None
    matrix = world_of(splats)
    center = matrix @ places[Frame.ORIGIN]
    ends = [matrix @ places[axis] for axis in (Frame.X, Frame.Y, Frame.Z)]
    return _Sphere(center, max((end - center).length for end in ends))
