"""Operators of the sub-panel "Display", as search and Python call them."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.cvdgs_addon.compositor.apply import simulation_node
from cvdgs.cvdgs_addon.compositor.scene_tree import scene_tree
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene import crop, display, splats
from cvdgs.cvdgs_addon.scene.camera_view import views_3d
from cvdgs.cvdgs_addon.scene.cameras import is_capture_camera, use_camera
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.cvdgs_addon.scene.turntable import turntable_of
from cvdgs.cvdgs_addon.shown import shown_layer
from cvdgs.ui import display as display_panel
from cvdgs.ui.display import CVDGS_PT_display

from .layouts import drawn
from .scenes import read_png, render_png


@pytest.fixture
def shown(addon, run_folder):
    """The Gaussians of a run in the open file."""
    return show_run(str(run_folder), bpy.context.scene)


def test_without_gaussians_the_operators_say_what_is_missing(addon):
    for name in ("show_layer", "show_form", "add_crop_box", "remove_crop_box", "set_up_render"):
        operator = getattr(bpy.ops.cvdgs, name)
        assert not operator.poll()
        with pytest.raises(RuntimeError, match="Start a run"):
            operator()


def test_a_layer_is_shown_as_far_as_the_one_before(shown):
    splats.set_input(shown, Input.ENHANCED, 0.4)
    bpy.ops.cvdgs.show_layer(layer="tritan-0.5")
    assert shown_layer(shown) == ("tritan-0.5", pytest.approx(0.4))
    with pytest.raises(RuntimeError, match=r"no colour layer 'protan-1\.0' - choose original"):
        bpy.ops.cvdgs.show_layer(layer="protan-1.0")


def test_points_a_crop_box_and_back(shown):
    bpy.ops.cvdgs.show_form(form="POINTS")
    assert splats.get_input(shown, Input.AS_POINTS)
    bpy.ops.cvdgs.show_form(form="INSTANCES")
    assert not splats.get_input(shown, Input.AS_POINTS)
    bpy.ops.cvdgs.add_crop_box()
    box = crop.crop_box_of(shown)
    bpy.ops.cvdgs.add_crop_box()
    assert crop.crop_box_of(shown) == box, "a second press selects the box that is there"
    assert bpy.context.view_layer.objects.active == box
    bpy.ops.cvdgs.remove_crop_box()
    assert crop.crop_box_of(shown) is None


def test_anti_aliasing_is_turned_off_where_the_processor_draws(shown, monkeypatch):
    system = bpy.context.preferences.system
    before = system.viewport_aa
    system.viewport_aa = "8"
    bpy.ops.cvdgs.show_form(form="PREVIEW")
    assert "cvdgs.draw_faster" not in drawn(CVDGS_PT_display).operators, "nothing draws in background"
    monkeypatch.setattr(
        display_panel, "smooths_slowly", lambda context: context.preferences.system.viewport_aa != "OFF"
    )
    assert "cvdgs.draw_faster" in drawn(CVDGS_PT_display).operators
    try:
        assert bpy.ops.cvdgs.draw_faster() == {"FINISHED"}
        assert system.viewport_aa == "OFF"
        assert "cvdgs.draw_faster" not in drawn(CVDGS_PT_display).operators
    finally:
        system.viewport_aa = before


def test_the_render_is_set_up_as_chosen_and_restored(shown):
    scene = bpy.context.scene
    assert not bpy.ops.cvdgs.restore_render.poll()
    scene.cvdgs.display.engine, scene.cvdgs.display.colors = "EEVEE", "PHOTO"
    before = scene.render.filter_size
    bpy.ops.cvdgs.set_up_render()
    assert "EEVEE" in scene.render.engine
    assert scene.view_settings.view_transform == "Raw"
    bpy.ops.cvdgs.restore_render()
    assert scene.render.filter_size == before
    assert scene.view_settings.view_transform != "Raw"


def test_a_crop_box_that_was_deleted_can_be_selected_again(shown):
    bpy.ops.cvdgs.add_crop_box()
    box = crop.crop_box_of(shown)
    with bpy.context.temp_override(selected_objects=[box], active_object=box):
        bpy.ops.object.delete()
    assert not box.users_scene
    assert crop.crop_box_of(shown) == box, "it crops all the same"
    bpy.ops.cvdgs.add_crop_box()
    assert bpy.context.view_layer.objects.active == box
    assert box.select_get()


@pytest.mark.parametrize("chosen", ["target", "partner"])
def test_chosen_gaussians_that_were_deleted_are_not_saved(shown, tmp_path, chosen):
    display_settings = bpy.context.scene.cvdgs.display
    display_settings.target = None
    setattr(display_settings, chosen, shown)
    mesh, file = shown.data.name, str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file, copy=True)
    assert getattr(display_settings, chosen) == shown, "it is in the scene"
    with bpy.context.temp_override(selected_objects=[shown], active_object=shown):
        bpy.ops.object.delete()
    assert getattr(display_settings, chosen) == shown, "undo may bring it back"
    bpy.ops.wm.save_as_mainfile(filepath=file, copy=True)
    with bpy.data.libraries.load(file) as (saved, _):
        assert mesh not in saved.meshes
        assert saved.cameras, "the rest is there"


def view_in_color() -> None:
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area):
        assert bpy.ops.cvdgs.view_in_color() == {"FINISHED"}


def test_a_3d_view_shows_the_colours_through_a_photographs_camera(shown):
    scene = bpy.context.scene
    pixel = scene.render.preview_pixel_size
    view_in_color()
    assert is_capture_camera(scene.camera)
    assert scene.render.engine == "CYCLES"
    assert splats.get_input(shown, Input.CAMERA_VIEW)
    (view,) = views_3d()
    assert (view.shading.type, view.region_3d.view_perspective) == ("RENDERED", "CAMERA")
    bpy.ops.cvdgs.restore_render()
    assert view.shading.type == "SOLID", "EEVEE would hold Blender up for minutes without a graphics card"
    assert scene.render.preview_pixel_size == pixel


def own_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    """An artist's camera and output size."""
    scene.camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 3840, 2160, 50
    return scene.camera


def test_the_artists_camera_and_output_size_are_restored_after_a_3d_view_in_colour(shown):
    scene = bpy.context.scene
    mine = own_camera(scene)
    view_in_color()
    assert is_capture_camera(scene.camera)
    assert {"Camera", "Render > Resolution x"} <= {told.partition(":")[0] for told in display.render_changes(scene)}
    bpy.ops.cvdgs.restore_render()
    assert scene.camera == mine
    render = scene.render
    assert (render.resolution_x, render.resolution_y, render.resolution_percentage) == (3840, 2160, 50)


def test_the_artists_camera_is_restored_after_the_turntable_that_was_looked_through_is_gone(shown):
    scene = bpy.context.scene
    mine = own_camera(scene)
    bpy.ops.cvdgs.add_turntable()
    view_in_color()
    assert scene.camera == turntable_of(scene)
    bpy.ops.cvdgs.remove_turntable()
    bpy.ops.cvdgs.restore_render()
    assert scene.camera == mine


def test_a_camera_that_the_artist_deletes_meanwhile_does_not_come_back(shown):
    scene = bpy.context.scene
    own_camera(scene)
    view_in_color()
    with bpy.context.temp_override(selected_objects=[scene.objects["Mine"]]):
        bpy.ops.object.delete()
    assert "Mine" not in scene.objects
    bpy.ops.cvdgs.restore_render()
    assert scene.camera is None
    assert scene.render.resolution_x == 3840


BORDER = [f"border_{end}_{axis}" for end in ("min", "max") for axis in "xy"]


@pytest.mark.parametrize("in_use", [False, True])
def test_a_3d_view_shows_the_whole_frame_unless_a_region_of_it_is_in_use(shown, in_use):
    render = bpy.context.scene.render
    region = dict(zip(BORDER, (0.25, 0.25, 0.5, 0.75), strict=True))
    for name, side in region.items():
        setattr(render, name, side)
    render.use_border = in_use
    view_in_color()
    assert render.use_border
    whole = dict(zip(BORDER, (0.0, 0.0, 1.0, 1.0), strict=True))
    assert {name: getattr(render, name) for name in BORDER} == (region if in_use else whole)
    view_in_color()
    bpy.ops.cvdgs.restore_render()
    assert render.use_border == in_use
    assert {name: getattr(render, name) for name in BORDER} == region


def test_a_3d_view_looks_through_the_turntables_camera_where_that_is_the_scenes(shown):
    scene = bpy.context.scene
    bpy.ops.cvdgs.add_turntable()
    scene.camera = turntable_of(scene)
    view_in_color()
    assert scene.camera == turntable_of(scene)


def test_a_simulation_follows_the_view_transform_that_is_set_up(shown):
    """AgX moves into the compositor; what is set up for Gaussians needs no such nodes, and comes back with it."""
    scene = bpy.context.scene
    scene.view_settings.view_transform = "AgX"
    display.match_display(scene)
    scene.cvdgs.simulate.in_renders = True
    nodes = len(scene_tree(scene).nodes)
    assert simulation_node(scene).inputs["Display Referred"].default_value
    display.match_display(scene)
    assert splats.get_input(shown, Input.SCENE_LINEAR), "light goes into the view transform, wherever that is"
    bpy.ops.cvdgs.set_up_render()
    assert len(scene_tree(scene).nodes) == nodes - 2
    assert not splats.get_input(shown, Input.SCENE_LINEAR)
    bpy.ops.cvdgs.restore_render()
    assert len(scene_tree(scene).nodes) == nodes
    scene.cvdgs.simulate.in_renders = False
    assert scene.view_settings.view_transform == "AgX"


def test_colours_follow_a_view_transform_that_is_chosen_by_hand(shown, tmp_path):
    scene = bpy.context.scene
    bpy.ops.cvdgs.set_up_render()
    use_camera(scene, next(filter(is_capture_camera, scene.objects)))
    scene.view_settings.view_transform = "Standard"
    at_once = render_png(scene, tmp_path / "at_once.png")
    assert splats.get_input(shown, Input.SCENE_LINEAR)
    np.testing.assert_array_equal(render_png(scene, tmp_path / "again.png"), at_once)
    scene.view_settings.view_transform = "Raw"
    bpy.context.view_layer.update()
    assert not splats.get_input(shown, Input.SCENE_LINEAR)
    splats.set_input(shown, Input.SCENE_LINEAR, True)
    render_png(scene, tmp_path / "by_hand.png")
    assert splats.get_input(shown, Input.SCENE_LINEAR), "what was chosen for them since stays"


def test_gaussians_of_two_scenes_are_rendered_in_colours_that_suit_each(shown, tmp_path):
    scene = bpy.context.scene
    bpy.ops.cvdgs.set_up_render()
    use_camera(scene, next(filter(is_capture_camera, scene.objects)))
    before = render_png(scene, tmp_path / "before.png")
    bpy.ops.scene.new(type="LINK_COPY")
    bpy.ops.cvdgs.restore_render()
    assert splats.get_input(shown, Input.SCENE_LINEAR)
    scene.render.filepath = str(tmp_path / "after.png")
    bpy.ops.render.render(scene=scene.name, write_still=True)
    np.testing.assert_array_equal(read_png(tmp_path / "after.png"), before)
    assert splats.get_input(shown, Input.SCENE_LINEAR), "the window shows the copy"


def test_a_window_that_changes_to_another_scene_shows_the_colours_that_suit_it(shown):
    scene, window = bpy.context.scene, bpy.context.window
    bpy.ops.cvdgs.set_up_render()
    bpy.ops.scene.new(type="LINK_COPY")
    copy = window.scene
    bpy.ops.cvdgs.restore_render()
    bpy.context.view_layer.update()
    assert splats.get_input(shown, Input.SCENE_LINEAR)
    for chosen, is_light in ((scene, False), (copy, True)):
        window.scene = chosen
        assert bool(splats.get_input(shown, Input.SCENE_LINEAR)) == is_light


def test_the_panel_shows_layers_form_and_what_was_changed(shown):
    bpy.ops.cvdgs.show_layer(layer="tritan-0.5")
    panel = drawn(CVDGS_PT_display)
    assert {"original", "deutan-1.0", "tritan-0.5", "Instances", "Points", "Native"} <= set(panel.texts)
    assert "cvdgs.add_crop_box" in panel.operators
    assert "cvdgs.remove_crop_box" not in panel.operators
    assert "AgX changes the photographs' colours" in " ".join(panel.texts)
    bpy.ops.cvdgs.add_crop_box()
    bpy.ops.cvdgs.set_up_render()
    panel = drawn(CVDGS_PT_display)
    assert "changes the photographs' colours" not in " ".join(panel.texts)
    assert "cvdgs.remove_crop_box" in panel.operators
    assert "View transform: " in " ".join(panel.texts)


def test_the_panel_says_what_changes_the_photographs_colours(shown):
    scene = bpy.context.scene

    def told() -> list[str]:
        return [text.split(" changes ")[0] for text in drawn(CVDGS_PT_display).texts if " changes " in text]

    bpy.ops.cvdgs.set_up_render()
    assert told() == []
    scene.view_settings.use_white_balance = True
    assert told() == ["White balance"]
    scene.view_settings.use_white_balance = False
    saved = scene.render.image_settings
    saved.color_management, saved.view_settings.view_transform = "OVERRIDE", "AgX"
    assert told() == ["AgX of the output"]
    bpy.ops.cvdgs.set_up_render()
    assert told() == []


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="this Blender has one working space")
def test_the_panel_warns_of_another_working_space_with_lamps(shown):
    chosen = bpy.context.scene.cvdgs.display

    def warns() -> bool:
        return "Working space ACEScg shifts" in " ".join(drawn(CVDGS_PT_display).texts)

    chosen.colors = "SCENE_LINEAR"
    assert not warns()
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=False)
    try:
        assert warns()
        chosen.colors = "PHOTO"
        assert not warns(), "values are shown as they are"
    finally:
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709", convert_colors=False)


def test_the_panel_warns_of_fog_until_the_render_is_set_up(shown):
    bpy.context.scene.render.engine = "CYCLES"
    assert "8 of 512 transparent bounces: renders will be grey" in " ".join(drawn(CVDGS_PT_display).texts)
    bpy.ops.cvdgs.set_up_render()
    assert "transparent bounces: renders" not in " ".join(drawn(CVDGS_PT_display).texts)


def test_without_gaussians_the_panel_says_what_to_do_first(addon):
    assert any("first" in text for text in drawn(CVDGS_PT_display).texts)
