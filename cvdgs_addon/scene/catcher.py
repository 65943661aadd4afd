"""Floors that show nothing but the shadows that an artist's objects throw on the Gaussians.

The artist moves an Empty. The plane that catches is its child and only in the scene that renders the objects (see
`apart`): beside Gaussians it would hide what lies below it.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import mathutils
import numpy as np

from .bystanders import is_surface
from .splat_attributes import core_of, point_positions
from .world_matrix import is_evaluated, scale_of, world_of

NAME = "Shadow Catcher"

_HANDLE, _PLANE = "cvdgs_shadow_catcher", "cvdgs_shadow_catcher_plane"  # custom properties of the Empty
_FLOOR = 5.0  # percentile of the Gaussians' heights, for a floor with nothing on it
_RADII = 1.5  # half of its side, in radii of the Gaussians' core
_CORNERS = ((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0))


def add_catcher(scene: bpy.types.Scene, splats: bpy.types.Object, standing: list[bpy.types.Object]) -> bpy.types.Object:
    """Add a level floor under the objects `standing` on it, or under the Gaussians; returns the Empty that moves it."""
    bpy.context.view_layer.update()
    center, radius = core_of(splats)
    positions = point_positions(splats.data)
    matrix = np.array(world_of(splats))
    center = matrix[:3, :3] @ center + matrix[:3, 3]
    radius *= scale_of(world_of(splats))
    heights = positions @ matrix[2, :3] + matrix[2, 3]
    # Of others Blender knows neither where they are nor how large.
    corners = (corner for found in filter(is_evaluated, standing) for corner in _corners(found, found.matrix_world))
    floor = min((corner.z for corner in corners), default=float(np.percentile(heights, _FLOOR)))
    handle = bpy.data.objects.new(NAME, None)
    handle[_HANDLE] = True
    handle.empty_display_type, handle.empty_display_size = "CUBE", 1.0
    handle.location = (float(center[0]), float(center[1]), floor)
    handle.scale = (_RADII * float(radius), _RADII * float(radius), 1e-3 * float(radius))
    scene.collection.objects.link(handle)
    mesh = bpy.data.meshes.new(NAME)
    mesh.from_pydata(_CORNERS, [], [(0, 1, 2, 3)])
    plane = bpy.data.objects.new(f"{NAME} Plane", mesh)
    plane.parent, plane.is_shadow_catcher = handle, True
    keep_catchers(handle)
    return handle


def keep_catchers(handle: bpy.types.Object) -> None:
    """Let files keep the plane of `handle` also where no scene has it, as while nothing is rendered apart."""
    for plane in catchers_of(handle):
        handle[_PLANE] = plane


def _corners(found: bpy.types.Object, matrix: mathutils.Matrix) -> Iterator[mathutils.Vector]:
    """Corners of what an object shows where `matrix` puts it; of an instance those of all that it shows."""
    if found.type != "EMPTY":
        yield from (matrix @ mathutils.Vector(corner) for corner in found.bound_box)
    elif found.instance_collection is not None:
        base = matrix @ mathutils.Matrix.Translation(-found.instance_collection.instance_offset)
        for inner in filter(is_surface, found.instance_collection.all_objects):
            yield from _corners(inner, base @ inner.matrix_world)


def is_catcher_handle(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is an Empty of `add_catcher`."""
    return bool(candidate.get(_HANDLE)) and candidate.type == "EMPTY"


def catchers_of(handle: bpy.types.Object) -> list[bpy.types.Object]:
    """The plane that catches shadows where `handle` stands; none where somebody deleted it."""
    return [child for child in handle.children if child.type == "MESH" and child.is_shadow_catcher]
