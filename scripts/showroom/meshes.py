"""Surfaces in Blender: mesh objects, boxes, and cloth simulation. bpy and numpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bmesh  # type: ignore[import-not-found]
import bpy
import numpy as np
from numpy.typing import NDArray

from .cloth import Surface

# Blender's scale (0 to 80): plaster holds woven cloth well.
OBSTACLE_FRICTION = 30.0


@dataclass(frozen=True)
class ClothPhysics:
    """What a simulated cloth is like; Blender's units (kg, N/m).

    Attributes:
        frames: how long it falls, at 24 frames a second.
        mass: of a vertex.
        bending: resistance to folds: silk about 0.05, wool 5, felt 15.
        pressure: inflation of a closed cover; 0 for open cloth.
        shrink: share by which a cover's fabric contracts, which wrinkles its seams.
        distance: kept to obstacles, metres.
    """

    frames: int = 60
    mass: float = 0.15
    bending: float = 0.5
    pressure: float = 0.0
    shrink: float = 0.0
    distance: float = 0.006
    gravity: float = 1.0
    self_collision: bool = True


def add_surface(name: str, surface: Surface, smooth: bool = True) -> bpy.types.Object:
    """A mesh object in the current scene with the surface's cloth coordinates as its UV map (in metres)."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(surface.vertices))
    mesh.vertices.foreach_set("co", surface.vertices.astype(np.float32).ravel())
    mesh.loops.add(surface.faces.size)
    mesh.loops.foreach_set("vertex_index", surface.faces.ravel())
    mesh.polygons.add(len(surface.faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, surface.faces.size, 4, dtype=np.int32))
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", surface.uv[surface.faces.ravel()].astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    mesh.polygons.foreach_set("use_smooth", np.full(len(surface.faces), smooth))
    return _link(name, mesh)


def add_box(name: str, low: Sequence[float], high: Sequence[float], bevel: float = 0.012) -> bpy.types.Object:
    """A box with rounded edges between two corners; its UV map is in metres on every side."""
    corners = np.asarray([low, high], float)
    mesh = bpy.data.meshes.new(name)
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=1.0)
    for vertex in shape.verts:
        vertex.co = np.where(np.array(vertex.co) > 0, corners[1], corners[0])
    bmesh.ops.bevel(shape, geom=shape.edges[:], offset=bevel, segments=3, affect="EDGES", profile=0.5)
    return _finish_solid(name, mesh, shape)


def add_cylinder(
    name: str,
    base: Sequence[float],
    radius: float,
    height: float,
    bevel: float = 0.008,
    rotation: NDArray[np.float64] | None = None,
) -> bpy.types.Object:
    """An upright cylinder with rounded rims, standing at `base`; `rotation` (3, 3) turns it about its base."""
    mesh = bpy.data.meshes.new(name)
    shape = bmesh.new()
    bmesh.ops.create_cone(shape, cap_ends=True, segments=96, radius1=radius, radius2=radius, depth=height)
    turn = np.eye(3) if rotation is None else rotation
    rims = [edge for edge in shape.edges if abs(edge.verts[0].co.z - edge.verts[1].co.z) < 1e-6]
    if bevel:
        bmesh.ops.bevel(shape, geom=rims, offset=bevel, segments=3, affect="EDGES", profile=0.5)
    lift = np.array([0.0, 0.0, height / 2])
    for vertex in shape.verts:
        vertex.co = turn @ (np.array(vertex.co) + lift) + np.asarray(base, float)
    return _finish_solid(name, mesh, shape)


def _finish_solid(name: str, mesh: bpy.types.Mesh, shape: bmesh.types.BMesh) -> bpy.types.Object:
    """Store a solid with smooth rounded edges and box-projected UVs."""
    bmesh.ops.recalc_face_normals(shape, faces=shape.faces[:])
    layer = shape.loops.layers.uv.new("UVMap")
    for face in shape.faces:
        face.smooth = True
        axis = int(np.argmax(np.abs(face.normal)))
        first, second = [(1, 2), (0, 2), (0, 1)][axis]
        for loop in face.loops:
            loop[layer].uv = (loop.vert.co[first], loop.vert.co[second])
    shape.to_mesh(mesh)
    shape.free()
    obj = _link(name, mesh)
    weighted = obj.modifiers.new("normals", "WEIGHTED_NORMAL")
    weighted.keep_sharp = True
    return obj


def _link(name: str, mesh: bpy.types.Mesh) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def simulate(
    surface: Surface,
    physics: ClothPhysics,
    obstacles: Sequence[bpy.types.Object] = (),
    pinned: NDArray[np.bool_] | None = None,
) -> Surface:
    """Let a cloth fall on the obstacles (or a cover inflate) and return its last shape. The scene is left as it was.

    Args:
        pinned: (N,) vertices that stay where they are, or None.
    """
    obj = add_surface("simulated cloth", surface)
    pins = obj.vertex_groups.new(name="pins")
    if pinned is not None:
        pins.add(np.flatnonzero(pinned).tolist(), 1.0, "REPLACE")
    collisions = [(obstacle, obstacle.modifiers.new("collision", "COLLISION")) for obstacle in obstacles]
    for obstacle, _ in collisions:
        obstacle.collision.thickness_outer = physics.distance
        obstacle.collision.cloth_friction = OBSTACLE_FRICTION
    try:
        modifier = obj.modifiers.new("cloth", "CLOTH")
        _configure(modifier, physics)
        modifier.settings.vertex_group_mass = pins.name
        scene = bpy.context.scene
        for frame in range(1, physics.frames + 1):
            scene.frame_set(frame)
        vertices = _evaluated_vertices(obj)
        scene.frame_set(1)
    finally:
        for obstacle, modifier in collisions:
            obstacle.modifiers.remove(modifier)
        mesh = obj.data
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(mesh)
    return replace(surface, vertices=vertices)


def _configure(modifier: bpy.types.Modifier, physics: ClothPhysics) -> None:
    settings, collision = modifier.settings, modifier.collision_settings
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 1, physics.frames
    settings.quality = 7
    settings.mass = physics.mass
    settings.air_damping = 1.0
    settings.bending_model = "ANGULAR"
    settings.bending_stiffness = physics.bending
    settings.bending_damping = 0.5
    settings.tension_stiffness = settings.compression_stiffness = 15.0
    settings.shear_stiffness = 5.0
    settings.effector_weights.gravity = physics.gravity
    settings.use_pressure = physics.pressure > 0
    settings.uniform_pressure_force = physics.pressure
    settings.shrink_min = physics.shrink
    collision.use_collision = True
    collision.distance_min = physics.distance
    collision.collision_quality = 3
    collision.use_self_collision = physics.self_collision
    collision.self_distance_min = physics.distance


def _evaluated_vertices(obj: bpy.types.Object) -> NDArray[np.float64]:
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    vertices = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", vertices)
    evaluated.to_mesh_clear()
    return vertices.reshape(-1, 3).astype(np.float64)
