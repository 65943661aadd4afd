"""Where things stand does not depend on whether and how they are hidden."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from cvdgs.core.splats.io.ply import read_ply
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.alignment import add_marks, align_by_photographs, places_of_marks
from cvdgs.cvdgs_addon.scene.crop import crop_box_of
from cvdgs.cvdgs_addon.scene.neighbours import overlapping
from cvdgs.cvdgs_addon.scene.turntable import turntable_of
from cvdgs.cvdgs_addon.scene.world_matrix import world_of

from .scenes import synthetic_run


def layer_collection(name: str) -> bpy.types.LayerCollection:
    def found_in(branch):
        return [branch] * (branch.name == name) + [found for child in branch.children for found in found_in(child)]

    return found_in(bpy.context.view_layer.layer_collection)[0]


def hide(splats: bpy.types.Object, how: str) -> None:
    """Hide Gaussians and all that belongs to them."""
    collection = splats.users_collection[0]
    if how == "by the monitor icon":
        for found in (splats, *splats.parent.children, *splats.children):
            found.hide_viewport = True
    elif how == "by their collection's monitor icon":
        collection.hide_viewport = True
    elif how == "in an excluded collection":
        layer_collection(collection.name).exclude = True
    elif how == "by the key H":
        splats.hide_set(True)


def reopened(path: Path) -> bpy.types.Object:
    """Save and open the file; its Gaussians, whose old matrices are gone."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene.cvdgs.display.target


@pytest.fixture(
    params=["by the monitor icon", "by their collection's monitor icon", "in an excluded collection", "by the key H"]
)
def how(request) -> str:
    return request.param


@pytest.fixture
def placed(addon, run_folder) -> bpy.types.Object:
    """Gaussians of a capture that was moved, turned and resized."""
    splats = show_run(str(run_folder), bpy.context.scene)
    splats.location = (0.5, 0.0, 0.0)
    splats.parent.location, splats.parent.scale = (10.0, 0.0, 0.0), (2.0, 2.0, 2.0)
    splats.parent.rotation_euler = (0.0, 0.0, 1.0)
    bpy.context.view_layer.update()
    return splats


def test_the_matrix_is_that_of_what_is_seen(placed, tmp_path, how):
    expected = np.array(placed.matrix_world)
    hide(placed, how)
    np.testing.assert_allclose(world_of(reopened(tmp_path / "scene.blend")), expected, atol=1e-6)


def test_hidden_gaussians_are_exported_where_they_stand(placed, tmp_path, how):
    bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "seen.ply"), axes="SCENE")
    bpy.ops.cvdgs.export_layers(filepath=str(tmp_path / "seen.glb"))
    hide(placed, how)
    reopened(tmp_path / "scene.blend")
    bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "hidden.ply"), axes="SCENE")
    bpy.ops.cvdgs.export_layers(filepath=str(tmp_path / "hidden.glb"))
    np.testing.assert_allclose(
        read_ply(tmp_path / "hidden.ply").means, read_ply(tmp_path / "seen.ply").means, atol=1e-5
    )
    assert (tmp_path / "hidden.glb").read_bytes() == (tmp_path / "seen.glb").read_bytes()


def test_hidden_gaussians_are_cropped_as_those_that_are_seen(placed, tmp_path, how):
    bpy.ops.cvdgs.add_crop_box()
    box = crop_box_of(placed)
    box.location, box.scale = (0.8, 0.0, 0.0), (0.3, 0.3, 0.3)
    bpy.context.view_layer.update()
    bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "seen.ply"))
    hide(placed, how)
    reopened(tmp_path / "scene.blend")
    bpy.ops.cvdgs.export_gaussians(filepath=str(tmp_path / "hidden.ply"))
    assert len(read_ply(tmp_path / "hidden.ply")) == len(read_ply(tmp_path / "seen.ply")) < 400


def test_a_turntable_goes_around_where_hidden_gaussians_and_cameras_stand(placed, tmp_path, how):
    def rig_of_new_turntable() -> list[float]:
        bpy.ops.cvdgs.add_turntable()
        rig = turntable_of(bpy.context.scene).parent
        return [*rig.location, rig.empty_display_size, rig["start"], rig["swing"]]

    expected = rig_of_new_turntable()
    hide(placed, how)
    layer_collection("run Cameras").exclude = how == "in an excluded collection"
    reopened(tmp_path / "scene.blend")
    np.testing.assert_allclose(rig_of_new_turntable(), expected, atol=1e-5)


def test_hidden_gaussians_overlap_others_only_where_they_stand(placed, tmp_path, how):
    other = show_run(str(synthetic_run(tmp_path / "other")), bpy.context.scene)
    bpy.context.scene.cvdgs.display.target = placed
    name = other.name
    hide(placed, how)
    placed = reopened(tmp_path / "scene.blend")
    assert overlapping(bpy.context.scene, placed) == []
    placed.parent.location = (0.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    assert [found.name for found in overlapping(bpy.context.scene, placed)] == [name]


def test_hidden_gaussians_are_placed_beside_others_from_where_they_stand(placed, tmp_path, how):
    show_run(str(synthetic_run(tmp_path / "other")), bpy.context.scene)
    bpy.context.scene.cvdgs.display.target = placed
    placed.parent.location = (0.0, 2.0, 0.0)
    bpy.context.view_layer.update()
    turned, scale = placed.parent.rotation_euler.copy(), placed.parent.scale.copy()
    hide(placed, how)
    placed = reopened(tmp_path / "scene.blend")
    bpy.ops.cvdgs.place_beside()
    root = placed.parent
    np.testing.assert_allclose(
        (*root.location.yz, *root.rotation_euler, *root.scale), (2.0, 0.0, *turned, *scale), atol=1e-5
    )
    assert overlapping(bpy.context.scene, placed) == []


def test_hidden_runs_are_aligned_where_they_stand(placed, tmp_path, how):
    other = show_run(str(synthetic_run(tmp_path / "other")), bpy.context.scene)
    other.parent.location.y = -3.0
    add_marks(placed, other)
    bpy.context.view_layer.update()
    expected = list(places_of_marks(placed).values())
    hide(placed, how)
    name = other.name
    bpy.context.scene.cvdgs.display.target = placed
    placed = reopened(tmp_path / "scene.blend")
    np.testing.assert_allclose(list(places_of_marks(placed).values()), expected, atol=1e-5)
    other = bpy.data.objects[name]
    align_by_photographs(other, placed)
    np.testing.assert_allclose(world_of(other), world_of(placed.parent), atol=1e-5)
