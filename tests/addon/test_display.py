"""How Gaussians are displayed: forms, budget, crop box, and the render settings that they need."""

from __future__ import annotations

import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import SH_C0
from cvdgs.cvdgs_addon.scene import crop, display, splats
from cvdgs.cvdgs_addon.scene.convert import load_run
from cvdgs.cvdgs_addon.scene.display import Form
from cvdgs.cvdgs_addon.scene.finished_run import read_run
from cvdgs.cvdgs_addon.scene.native_splats import has_native_splats, native_attributes
from cvdgs.cvdgs_addon.scene.render_settings import Display, Engine
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.cvdgs_addon.scene.stills import render_still

from . import ewa
from .scenes import (
    CAMERA,
    cloud,
    drawn_points,
    look_through,
    opencv,
    read_png,
    render_png,
    ring_view,
    take,
)

POSE = ring_view(0.4)


@pytest.fixture
def view(scene):
    return look_through(scene, CAMERA, POSE)


def reference(gaussians) -> np.ndarray:
    return ewa.render(gaussians, gaussians.base_colors, CAMERA, opencv(POSE))


def importance(gaussians) -> np.ndarray:
    """Opacity times the product of the two longest axes."""
    axes = np.sort(np.exp(gaussians.log_scales), axis=1)
    return gaussians.opacities * axes[:, 1] * axes[:, 2]


# --------------------------------------------------------------------------------------------------------- the forms


def test_points_stand_where_gaussians_are_in_the_colours_that_are_shown(scene):
    gaussians = cloud(50)
    layer = 1.0 - gaussians.base_colors
    added = splats.add_gaussians(gaussians, {"deutan-1.0": layer}, scene.collection)
    display.show_form(added, Form.POINTS)
    splats.show_layer(added, "deutan-1.0", 0.25)
    positions, colors = drawn_points(added)
    assert display.form_of(added) is Form.POINTS
    visible = gaussians.opacities > 1 / 255
    np.testing.assert_allclose(positions, gaussians.means[visible], atol=1e-6)
    np.testing.assert_allclose(colors, (0.75 * gaussians.base_colors + 0.25 * layer)[visible], atol=1e-6)


def test_points_are_rendered_in_their_colours(scene, view, tmp_path):
    gaussians = take(cloud(1), [0])
    gaussians.means[:] = 0.0
    gaussians.log_scales[:] = np.log(0.3)
    gaussians.opacity_logits[:] = 3.0
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    display.show_form(added, Form.POINTS)
    image = render_png(scene, tmp_path / "points.png")
    np.testing.assert_allclose(image[int(CAMERA.cy), int(CAMERA.cx)], gaussians.base_colors[0], atol=1.0 / 255.0)


def test_forms_can_be_changed_back_and_forth(scene, view, tmp_path):
    gaussians = cloud(100)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    display.show_form(added, Form.POINTS)
    display.show_form(added, Form.INSTANCES)
    assert display.form_of(added) is Form.INSTANCES
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), reference(gaussians)) > 50.0


@pytest.mark.skipif(has_native_splats(), reason="this Blender has native splats")
def test_native_splats_are_refused_where_blender_has_none(scene):
    added = splats.add_gaussians(cloud(3), {}, scene.collection)
    with pytest.raises(InputError, match=r"has no splats of its own.*choose Instances"):
        display.show_form(added, Form.NATIVE)
    assert display.form_of(added) is Form.INSTANCES


def test_native_attributes_are_those_of_blenders_importer():
    gaussians = cloud(5)
    attributes = native_attributes(gaussians)
    assert {name: kind for name, (kind, _) in attributes.items()} == {
        "scale": "FLOAT_VECTOR",
        "rotation": "QUATERNION",
        "radiance:base": "FLOAT4",
    }
    base = attributes["radiance:base"][1]
    np.testing.assert_allclose(0.5 + SH_C0 * base[:, :3], gaussians.base_colors, atol=1e-6)
    np.testing.assert_allclose(base[:, 3], gaussians.opacities)
    np.testing.assert_allclose(np.linalg.norm(attributes["rotation"][1], axis=1), 1.0, atol=1e-6)


# ------------------------------------------------------------------------------------------------ budget and crop box


def test_a_budget_leaves_the_most_important_gaussians(scene, view, tmp_path):
    gaussians = cloud(200)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    splats.set_input(added, Input.BUDGET, 60)
    kept = np.argsort(-importance(gaussians))[:60]
    assert ewa.psnr(render_png(scene, tmp_path / "all.png"), reference(gaussians)) > 50.0
    splats.set_input(added, Input.BUDGET_IN_RENDERS, True)
    expected = reference(take(gaussians, np.sort(kept)))
    assert ewa.psnr(render_png(scene, tmp_path / "some.png"), expected) > 50.0


def test_the_viewport_keeps_to_the_budget(scene):
    """What is evaluated outside of a render is what the viewport shows."""
    added = splats.add_gaussians(cloud(200), {}, scene.collection)
    splats.set_input(added, Input.AS_POINTS, True)
    splats.set_input(added, Input.BUDGET, 60)
    assert len(drawn_points(added)[0]) == 60


def test_a_crop_box_hides_what_is_outside_wherever_it_is_moved(scene, view, tmp_path):
    gaussians = cloud(200)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    box = crop.add_crop_box(added)
    assert crop.crop_box_of(added) == box
    turn = mathutils.Matrix.LocRotScale((0.3, -0.2, 0.1), mathutils.Euler((0.0, 0.0, 0.6)), (0.5, 0.7, 0.9))
    box.matrix_basis = turn
    local = np.linalg.inv(np.array(turn)) @ np.c_[gaussians.means, np.ones(200)].T
    inside = np.flatnonzero(np.abs(local[:3]).max(axis=0) <= 1.0)
    assert 10 < len(inside) < 150
    bpy.context.view_layer.update()
    image = render_png(scene, tmp_path / "cropped.png")
    assert ewa.psnr(image, reference(take(gaussians, inside))) > 50.0
    crop.remove_crop_box(added)
    assert crop.crop_box_of(added) is None
    assert ewa.psnr(render_png(scene, tmp_path / "all.png"), reference(gaussians)) > 50.0


def test_a_duplicate_that_loses_its_crop_box_leaves_it_to_the_original(scene):
    added = splats.add_gaussians(cloud(200), {}, scene.collection)
    box = crop.add_crop_box(added)
    box.scale = (0.5, 0.5, 0.5)
    duplicate = added.copy()
    scene.collection.objects.link(duplicate)
    for target in (added, duplicate):
        splats.set_input(target, Input.AS_POINTS, True)
    cropped = len(drawn_points(added)[0])
    crop.remove_crop_box(duplicate)
    assert len(drawn_points(duplicate)[0]) == 200
    assert crop.crop_box_of(added) == box
    assert len(drawn_points(added)[0]) == cropped < 200
    crop.remove_crop_box(added)
    assert "Gaussians Crop" not in bpy.data.objects


def test_without_its_box_nothing_is_cropped(scene):
    added = splats.add_gaussians(cloud(200), {}, scene.collection)
    added.data.transform(mathutils.Matrix.Translation((5.0, 0.0, 0.0)))
    bpy.data.objects.remove(crop.add_crop_box(added))
    splats.set_input(added, Input.AS_POINTS, True)
    assert splats.get_input(added, Input.CROP)
    assert len(drawn_points(added)[0]) == 200


def test_a_new_crop_box_holds_most_of_the_scene(scene):
    gaussians = cloud(400)
    gaussians.means[:4] += 500.0  # floaters
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    crop.add_crop_box(added)
    splats.set_input(added, Input.AS_POINTS, True)
    shown = len(drawn_points(added)[0])
    assert 0.9 * 400 < shown <= 396


# ----------------------------------------------------------------------------------------------------- render settings


@pytest.fixture
def artists_scene(run_folder):
    """A start file as it is, with a run in it."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    load_run(read_run(run_folder), scene)
    return scene


def all_settings(scene: bpy.types.Scene) -> dict[str, object]:
    """Every plain setting that could be changed."""
    found = {"world": scene.world and scene.world.name}
    for path in (
        *("render", "render.image_settings", "cycles", "eevee"),
        *("view_settings", "display_settings", "sequencer_colorspace_settings"),
    ):
        owner = scene.path_resolve(path)
        for item in owner.bl_rna.properties:
            is_plain = item.type in ("BOOLEAN", "INT", "FLOAT", "ENUM", "STRING") and not getattr(
                item, "is_array", False
            )
            if is_plain and not item.is_readonly:
                found[f"{path}.{item.identifier}"] = getattr(owner, item.identifier)
    return found


@pytest.mark.parametrize("engine", Engine)
@pytest.mark.parametrize("shown", Display)
def test_render_settings_are_told_and_undone(artists_scene, engine, shown):
    artists_scene.view_settings.use_white_balance = True
    artists_scene.render.image_settings.color_management = "OVERRIDE"
    before = all_settings(artists_scene)
    told = display.set_up_render(artists_scene, engine, shown)
    changed = {name for name, value in all_settings(artists_scene).items() if value != before[name]}
    assert len(told) == len(changed), (told, changed)
    assert len(told) > 3
    assert list(display.render_changes(artists_scene)) == told
    display.restore_render(artists_scene)
    assert all_settings(artists_scene) == before
    assert list(display.render_changes(artists_scene)) == []


@pytest.mark.parametrize("shown", Display)
def test_neither_white_balance_nor_colours_of_the_output_change_what_is_set_up(artists_scene, tmp_path, shown):
    look_through(artists_scene, CAMERA, POSE)
    display.set_up_render(artists_scene, Engine.CYCLES, shown)
    expected = render_png(artists_scene, tmp_path / "expected.png")
    display.restore_render(artists_scene)
    view, saved = artists_scene.view_settings, artists_scene.render.image_settings
    view.use_white_balance, view.white_balance_temperature = True, 4000.0
    saved.color_management, saved.view_settings.view_transform = "OVERRIDE", "AgX"
    display.set_up_render(artists_scene, Engine.CYCLES, shown)
    np.testing.assert_array_equal(render_png(artists_scene, tmp_path / "seen.png"), expected)


def test_what_somebody_changed_in_the_meantime_is_not_undone(artists_scene):
    display.set_up_render(artists_scene, Engine.CYCLES, Display.PHOTO)
    artists_scene.cycles.samples = 77
    display.restore_render(artists_scene)
    assert artists_scene.cycles.samples == 77
    assert artists_scene.view_settings.view_transform != "Raw"


def test_a_world_that_was_renamed_in_the_meantime_is_restored(artists_scene):
    world = artists_scene.world
    display.set_up_render(artists_scene, Engine.CYCLES, Display.PHOTO)
    assert artists_scene.world != world
    world.name = "Evening"
    assert any("Evening" in change for change in display.restore_render(artists_scene))
    assert artists_scene.world == world


def test_colours_follow_the_view_transform(artists_scene):
    (added,) = [candidate for candidate in artists_scene.objects if splats.is_splats(candidate)]
    assert splats.get_input(added, Input.SCENE_LINEAR), "the start file shows light"
    display.set_up_render(artists_scene, Engine.CYCLES, Display.PHOTO)
    assert not splats.get_input(added, Input.SCENE_LINEAR)
    display.restore_render(artists_scene)
    assert splats.get_input(added, Input.SCENE_LINEAR)


def test_settings_can_be_undone_after_saving_and_loading(artists_scene, tmp_path):
    world, engine = artists_scene.world.name, artists_scene.render.engine
    display.set_up_render(artists_scene, Engine.CYCLES, Display.PHOTO)
    assert artists_scene.world.name != world
    path = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = bpy.context.scene
    display.restore_render(scene)
    assert (scene.world.name, scene.render.engine) == (world, engine)


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="files of Blender 5 are not those of an earlier one")
@pytest.mark.parametrize("engine", Engine)
def test_a_file_that_blender_4_saved_gets_its_engine_back(artists_scene, engine):
    other = "CYCLES" if engine is Engine.EEVEE else "BLENDER_EEVEE"
    artists_scene.render.engine = other
    display.set_up_render(artists_scene, engine, Display.PHOTO)
    record = artists_scene["cvdgs_render"]
    artists_scene["cvdgs_render"] = record.replace('"BLENDER_EEVEE"', '"BLENDER_EEVEE_NEXT"')
    assert artists_scene["cvdgs_render"] != record
    display.restore_render(artists_scene)
    assert artists_scene.render.engine == other


def warnings(target: bpy.types.Object) -> list[str]:
    """What the modifier of an object complains of."""
    bpy.context.evaluated_depsgraph_get()
    return [warning.message for warning in target.modifiers[splats.MODIFIER_NAME].node_warnings]


def test_gaussians_in_another_file_warn_of_fog_by_themselves(scene, tmp_path):
    """Appended, without the add-on, into a file as Blender makes it, with Cycles and with another engine."""
    added = splats.add_gaussians(cloud(3), {}, scene.collection)
    assert warnings(added) == []
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {added})
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    with bpy.data.libraries.load(path) as (_, wanted):
        wanted.objects = ["Gaussians"]
    (appended,) = wanted.objects
    assert bpy.context.scene.render.engine != "CYCLES"
    bpy.context.scene.collection.objects.link(appended)
    assert warnings(appended) == []
    bpy.context.scene.render.engine = "CYCLES"
    (message,) = warnings(appended)
    assert message.startswith("8 of 512 transparent bounces: renders will be grey")
    display.set_up_render(bpy.context.scene, Engine.CYCLES, Display.PHOTO)
    assert warnings(appended) == []


def test_an_object_set_up_in_an_artists_scene_renders_as_trained(artists_scene, run_folder, tmp_path):
    run = read_run(run_folder)
    for candidate in list(artists_scene.objects):
        if candidate.name in ("Cube", "Light"):
            bpy.data.objects.remove(candidate)
    display.set_up_render(artists_scene, Engine.CYCLES, Display.PHOTO)

    (added,) = [candidate for candidate in artists_scene.objects if splats.is_splats(candidate)]
    splats.show_layer(added, "original")
    render_still(artists_scene, artists_scene.objects["view1"], tmp_path / "still.png")
    view = run.view("view1")
    expected = ewa.render(run.gaussians, run.gaussians.base_colors, view.camera, opencv(view.camera_to_world))
    assert ewa.psnr(read_png(tmp_path / "still.png"), expected) > 45.0
