"""Several runs in one file: their names, and those that stand in each other."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.cvdgs_addon.properties import is_target
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene.camera_view import views_3d
from cvdgs.cvdgs_addon.scene.cameras import is_capture_camera
from cvdgs.cvdgs_addon.scene.display import Form, form_of
from cvdgs.cvdgs_addon.scene.neighbours import overlapping, partner_of, place_beside
from cvdgs.cvdgs_addon.scene.splat_attributes import point_positions
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.cvdgs_addon.scene.splats import get_input
from cvdgs.ui.display import CVDGS_PT_display

from .layouts import drawn
from .scenes import synthetic_run
from .test_display_panel import view_in_color


@pytest.fixture
def two(addon, tmp_path):
    """Two runs of the same scene, where they were loaded; the second is the panels' own."""
    scene = bpy.context.scene
    shown = [show_run(str(synthetic_run(tmp_path / name)), scene) for name in ("shop", "window")]
    bpy.context.view_layer.update()
    return shown


def in_scene(splats: bpy.types.Object) -> np.ndarray:
    bpy.context.view_layer.update()
    matrix = np.array(splats.matrix_world)
    return point_positions(splats.data) @ matrix[:3, :3].T + matrix[:3, 3]


def test_objects_are_called_after_their_runs(two):
    assert [found.name for found in two] == ["shop Gaussians", "window Gaussians"]
    assert [found.parent.name for found in two] == ["shop Capture", "window Capture"]
    top = bpy.context.scene.collection.children
    assert {"shop", "window"} <= set(top.keys())
    assert list(top["shop"].children.keys()) == ["shop Cameras"]
    assert all(map(is_capture_camera, top["shop"].children["shop Cameras"].objects))


def test_only_gaussians_of_the_scene_can_be_chosen(two):
    first, second = two
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(second)
    assert is_target(bpy.context.scene.cvdgs.display, first)
    assert not is_target(other.cvdgs.display, first)
    assert is_target(other.cvdgs.display, second)


def test_the_panel_says_what_stands_in_what_and_hides_the_others(two):
    first, second = two
    panel = drawn(CVDGS_PT_display)
    assert "window Gaussians, shop Gaussians" in " ".join(panel.texts)
    assert {"cvdgs.hide_other_gaussians", "cvdgs.place_beside"} <= set(panel.operators)
    bpy.ops.cvdgs.hide_other_gaussians()
    assert first.hide_render
    assert first.hide_get()
    assert not second.hide_render
    assert "cvdgs.place_beside" not in drawn(CVDGS_PT_display).operators


def test_what_was_placed_beside_shares_no_place_and_keeps_its_cameras(two):
    first, second = two
    before = in_scene(second)
    camera = next(child for child in second.parent.children if is_capture_camera(child))
    seen = np.array(camera.matrix_world.inverted() @ second.matrix_world)
    bpy.ops.cvdgs.place_beside()
    after = in_scene(second)
    np.testing.assert_allclose((after - before)[:, 1:], 0.0, atol=1e-5)
    assert after[:, 0].min() > in_scene(first)[:, 0].max()
    np.testing.assert_allclose(np.array(camera.matrix_world.inverted() @ second.matrix_world), seen, atol=1e-5)
    assert overlapping(bpy.context.scene, second) == []


def test_a_script_that_has_just_moved_gaussians_can_place_them_beside(two):
    first, second = two
    second.parent.location = (0.0, 5.0, 0.0)
    bpy.ops.cvdgs.place_beside()
    assert second.parent.location.y == pytest.approx(5.0)
    first.parent.location.x += 100.0
    place_beside(bpy.context.scene, second)
    assert in_scene(second)[:, 0].min() > in_scene(first)[:, 0].max()


def test_a_duplicate_is_placed_beside_what_it_was_made_of(two):
    first, second = two
    bpy.data.objects.remove(first)
    before = in_scene(second)
    second.select_set(True)
    bpy.context.view_layer.objects.active = second
    bpy.ops.object.duplicate()
    duplicate = bpy.context.scene.cvdgs.display.target = bpy.context.object
    bpy.ops.cvdgs.place_beside()
    np.testing.assert_array_equal(in_scene(second), before)
    assert in_scene(duplicate)[:, 0].min() > before[:, 0].max()


def test_gaussians_with_duplicates_in_them_are_placed_beside(two):
    first, second = two
    for splats in two:
        bpy.context.scene.cvdgs.display.target = splats
        bpy.ops.cvdgs.edit_points()
        bpy.context.view_layer.update()
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.mesh.duplicate()
        bpy.ops.object.mode_set(mode="OBJECT")
    assert overlapping(bpy.context.scene, second) == [first]
    place_beside(bpy.context.scene, second)
    assert in_scene(second)[:, 0].min() > in_scene(first)[:, 0].max()


def test_gaussians_without_their_frame_overlap_nothing(two):
    first, second = two
    mesh = bpy.data.meshes.new("left")
    mesh.from_pydata([(0.0, 0.0, 0.0)], [], [])
    first.data = mesh
    assert overlapping(bpy.context.scene, second) == []


def test_a_run_that_comes_beside_a_rendered_view_does_not_hold_it_up(addon, tmp_path):
    """Its ellipsoids would: without a graphics card the view shows the preview until somebody renders again."""
    scene = bpy.context.scene
    first = show_run(str(synthetic_run(tmp_path / "shop")), scene)
    view_in_color()
    second = show_run(str(synthetic_run(tmp_path / "window")), scene)
    (view,) = views_3d()
    assert (view.shading.type, view.shading.color_type) == ("SOLID", "VERTEX")
    assert {form_of(first), form_of(second)} == {Form.PREVIEW}
    view_in_color()
    assert get_input(first, Input.CAMERA_VIEW)
    assert get_input(second, Input.CAMERA_VIEW)


def test_runs_in_an_excluded_collection_are_no_neighbours(two):
    first, second = two
    scene = bpy.context.scene
    assert partner_of(scene, second, None) == first
    bpy.context.view_layer.layer_collection.children[first.users_collection[0].name].exclude = True
    assert overlapping(scene, second) == []
    assert partner_of(scene, second, first) is None
