"""What renders show beside the Gaussians: an artist's own objects, and the cube of a new file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import bpy
import mathutils
import numpy as np

from .native_splats import is_native_splats
from .sparse_points import is_sparse_points
from .splat_attributes import vertex_positions
from .splats import is_splats
from .view_layers import rendered_objects

_SURFACES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}  # types of what renders show
_START_CUBE = "Cube"  # of Blender's start file
_CUBE_CORNERS, _CUBE_HALF_SIDE = 8, 1.0


def bystanders(scene: bpy.types.Scene) -> list[str]:
    """Objects that renders show now beside the Gaussians, such as the cube of a new file: their names."""
    rendered = rendered_objects(scene)
    return [
        found.name
        for found in surfaces(scene)
        if found in rendered and not found.hide_render and not _shows_gaussians_alone(found)
    ]


def surfaces(scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """What renders may show beside the Gaussians at some time, and what hides these: objects and instances of
    collections, also those that are hidden now: that may be keyed.
    """
    return filter(is_surface, scene.objects)


def is_surface(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is not of the Gaussians, and what renders show, or an instance of a collection."""
    if candidate.type == "EMPTY":
        return candidate.instance_type == "COLLECTION" and not is_instance_of_gaussians(candidate)
    return (
        candidate.type in _SURFACES
        and not (is_splats(candidate) or is_sparse_points(candidate))
        and not is_native_splats(candidate)  # `Object.children` goes through all objects of the file
    )


def is_instance_of_gaussians(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is an instance of a run, such as *Link* makes, with nothing else in it to be seen."""
    collection = candidate.instance_collection
    return collection is not None and _shows_gaussians_alone(candidate) and any(map(is_splats, collection.all_objects))


def has_rigid_bodies(scene: bpy.types.Scene) -> bool:
    """Whether Blender simulates rigid bodies in `scene`; once they are baked to keyframes it does not."""
    world = scene.rigidbody_world
    return world is not None and world.collection is not None and len(world.collection.objects) > 0


def hide(scene: bpy.types.Scene, names: Iterable[str]) -> None:
    """Hide objects of `scene` in the 3D views, as the key H does, and in renders."""
    for name in names:
        candidate = scene.objects[name]
        candidate.hide_render = True
        for layer in scene.view_layers:
            if name in layer.objects:
                candidate.hide_set(True, view_layer=layer)


def hide_start_cube(scene: bpy.types.Scene) -> bool:
    """Hide the cube of Blender's start file where nobody has touched it; returns whether it was there."""
    cube = scene.objects.get(_START_CUBE)
    if cube is None or cube.hide_render or not _is_untouched(cube):
        return False
    hide(scene, [cube.name])
    return True


def _shows_gaussians_alone(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is an instance of a run, such as *Link* makes, or of nothing."""
    if candidate.type != "EMPTY":
        return False
    collection = candidate.instance_collection
    return collection is None or not any(map(is_surface, collection.all_objects))


def _is_untouched(cube: bpy.types.Object) -> bool:
    """Whether a mesh is the start file's cube as it was: shape, place and looks."""
    if cube.type != "MESH" or cube.data.name != _START_CUBE or cube.matrix_world != mathutils.Matrix():
        return False
    if (
        cube.parent
        or cube.children
        or cube.modifiers
        or cube.constraints
        or cube.animation_data
        or cube.mode != "OBJECT"
    ):
        return False
    if [material.name for material in cube.data.materials if material] not in ([], ["Material"]):
        return False
    corners = vertex_positions(cube.data)
    return len(corners) == _CUBE_CORNERS and bool(np.all(np.abs(corners) == _CUBE_HALF_SIDE))
