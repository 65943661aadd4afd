"""What renders show beside the Gaussians."""

from __future__ import annotations

import bpy

from cvdgs.cvdgs_addon.scene import splats
from cvdgs.cvdgs_addon.scene.bystanders import bystanders
from cvdgs.cvdgs_addon.scene.native_splats import native_splats_of

from ..effort import function_calls
from .scenes import cloud


def add_parented(scene: bpy.types.Scene, count: int) -> None:
    """Meshes with an Empty for their parent."""
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    mesh = bpy.data.meshes.new("Part")
    for _ in range(count):
        part = bpy.data.objects.new("Part", mesh)
        part.parent = parent
        scene.collection.objects.link(part)


def test_four_times_the_parented_objects_are_four_times_the_work(scene):
    add_parented(scene, 100)
    few = function_calls(lambda: bystanders(scene))
    assert len(bystanders(scene)) == 100
    add_parented(scene, 300)
    assert len(bystanders(scene)) == 400
    assert function_calls(lambda: bystanders(scene)) < 5 * few


def test_blenders_own_splats_are_gaussians_and_other_point_clouds_are_not(scene):
    shown = splats.add_gaussians(cloud(3), {}, scene.collection)
    copy, scan = (bpy.data.objects.new(name, bpy.data.pointclouds.new(name)) for name in ("Native", "Scan"))
    for found in (copy, scan):
        found.parent = shown
        scene.collection.objects.link(found)
    copy["cvdgs_copy_of"] = shown.name  # as `add_native_splats` leaves it, which needs Blender 5.3
    duplicate = copy.copy()
    scene.collection.objects.link(duplicate)
    assert native_splats_of(shown) in (copy, duplicate)
    assert bystanders(scene) == ["Scan"]
