"""What renders show beside the Gaussians."""

from __future__ import annotations

import bpy
import pytest

from cvdgs.cvdgs_addon.scene import splats
from cvdgs.cvdgs_addon.scene.bystanders import bystanders, hide
from cvdgs.cvdgs_addon.scene.catcher import add_catcher
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


def add_chair(collection: bpy.types.Collection, height: float) -> bpy.types.Object:
    mesh = bpy.data.meshes.new("Chair")
    mesh.from_pydata([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.5)], [], [(0, 1, 2)])
    chair = bpy.data.objects.new("Chair", mesh)
    chair.location.z = height
    collection.objects.link(chair)
    return chair


def add_instance(scene: bpy.types.Scene, collection: bpy.types.Collection, height: float) -> bpy.types.Object:
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    instance.location.z = height
    scene.collection.objects.link(instance)
    return instance


@pytest.mark.parametrize("how", ["excluded", "hidden in renders", "in another view layer"])
def test_what_is_not_rendered_is_no_bystander_but_instances_of_it_are(scene, how):
    sources = bpy.data.collections.new("Sources")
    scene.collection.children.link(sources)
    chair = add_chair(sources, 0.0)
    assert bystanders(scene) == ["Chair"]
    layer = scene.view_layers[0]
    if how == "hidden in renders":
        sources.hide_render = True
    else:
        layer.layer_collection.children["Sources"].exclude = True
    if how == "in another view layer":
        scene.view_layers.new("Work").use = False
    assert bystanders(scene) == []
    add_instance(scene, sources, 0.0)
    assert bystanders(scene) == ["Instance"]
    hide(scene, bystanders(scene))
    assert bystanders(scene) == []
    assert not chair.hide_render


def test_an_instance_of_gaussians_alone_is_no_bystander(scene):
    run = bpy.data.collections.new("run")
    splats.add_gaussians(cloud(3), {}, run)
    add_instance(scene, run, 0.0)
    assert bystanders(scene) == []


def test_the_floor_is_below_what_is_seen_to_stand_on_it(scene):
    shown = splats.add_gaussians(cloud(30), {}, scene.collection)
    sources = bpy.data.collections.new("Sources")
    sources.instance_offset = (0.0, 0.0, 1.0)
    add_chair(sources, 3.0)
    instance = add_instance(scene, sources, 5.0)
    unseen = add_chair(scene.collection, -20.0)
    unseen.hide_viewport = True
    bpy.context.view_layer.update()
    handle = add_catcher(scene, shown, [instance, unseen])
    assert handle.location.z == pytest.approx(5.0 - 1.0 + 3.0)


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
