"""The preview: coloured quads in the viewport, which forms follow which shading, and the cube of a new file."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.core.color import srgb
from cvdgs.cvdgs_addon import registration
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene import preview, splats
from cvdgs.cvdgs_addon.scene.bystanders import bystanders, hide, hide_start_cube
from cvdgs.cvdgs_addon.scene.display import Form, form_of, show_form
from cvdgs.cvdgs_addon.scene.splat_attributes import Attribute, read_attribute, vertex_positions
from cvdgs.cvdgs_addon.scene.splat_nodes import Input

from . import ewa
from .scenes import CAMERA, cloud, look_through, opencv, render_png, ring_view, take


def quads(target: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """(Q, 4, 3) corners of the quads in the viewport, and the (Q, 3) linear colours that Solid shading shows."""
    mesh = target.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    corners = np.array([polygon.vertices[:] for polygon in mesh.polygons]).reshape(-1, 4)
    colors = read_attribute(mesh, mesh.attributes.active_color_name)[:, :3]
    return vertex_positions(mesh)[corners], colors[corners[:, 0]]


def test_a_quad_lies_in_the_plane_of_the_two_longest_axes(scene):
    gaussians = cloud(40)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    show_form(added, Form.PREVIEW)
    corners, _ = quads(added)
    assert form_of(added) is Form.PREVIEW
    visible = np.flatnonzero(gaussians.opacities > 1 / 255)
    centers = corners.mean(axis=1)
    order = np.linalg.norm(centers[:, None] - gaussians.means[None, visible], axis=2).argmin(axis=1)
    assert sorted(order) == list(range(len(visible)))
    scales = np.exp(gaussians.log_scales)[visible][order]
    opacity = gaussians.opacities[visible][order]
    sides = np.stack([np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1),
                      np.linalg.norm(corners[:, 3] - corners[:, 0], axis=1)], axis=1)  # fmt: skip
    expected = 3.0 * np.sqrt(opacity)[:, None] * np.sort(scales, axis=1)[:, 1:]
    np.testing.assert_allclose(np.sort(sides, axis=1), expected, rtol=1e-4)


def test_the_preview_has_the_light_of_the_colours_whatever_the_view_transform(scene):
    gaussians = cloud(30)
    layer = 1.0 - gaussians.base_colors
    added = splats.add_gaussians(gaussians, {"deutan-1.0": layer}, scene.collection)
    show_form(added, Form.PREVIEW)
    splats.show_layer(added, "deutan-1.0", 0.5)
    for is_light in (False, True):
        splats.set_input(added, Input.SCENE_LINEAR, is_light)
        np.testing.assert_allclose(quads(added)[1], srgb.decode(np.full((len(quads(added)[1]), 3), 0.5)), atol=1e-4)


def test_few_quads_stand_for_many_gaussians_and_renders_show_all(scene, tmp_path):
    gaussians = cloud(200)
    pose = ring_view(0.4)
    look_through(scene, CAMERA, pose)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    show_form(added, Form.PREVIEW)
    splats.set_input(added, Input.PREVIEW_COUNT, 50)
    assert len(quads(added)[0]) == 50
    expected = ewa.render(gaussians, gaussians.base_colors, CAMERA, opencv(pose))
    assert ewa.psnr(render_png(scene, tmp_path / "all.png"), expected) > 50.0
    show_form(added, Form.POINTS)
    assert form_of(added) is Form.POINTS


def test_quads_follow_an_applied_transform(scene):
    gaussians = take(cloud(3), [0, 1, 2])
    gaussians.opacity_logits[:] = 2.0
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    show_form(added, Form.PREVIEW)
    before, _ = quads(added)
    added.rotation_euler, added.scale = (0.3, -0.7, 1.1), (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    matrix = np.array(added.matrix_world)
    with bpy.context.temp_override(object=added, selected_editable_objects=[added]):
        bpy.ops.object.transform_apply()
    after, _ = quads(added)
    np.testing.assert_allclose(after, before @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-5)


# ---------------------------------------------------------------------------------------------------------- the shading


@pytest.fixture
def view(addon, run_folder):
    """A 3D view in a new file that a run was loaded into."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    show_run(str(run_folder), bpy.context.scene)
    return next(preview.views_3d())


def shown() -> bpy.types.Object:
    return next(found for found in bpy.context.scene.objects if splats.is_splats(found))


def test_a_run_that_was_loaded_shows_its_colours_without_a_card(view):
    assert form_of(shown()) is Form.PREVIEW
    shading = view.shading
    assert (shading.type, shading.light, shading.color_type) == ("SOLID", "FLAT", "VERTEX")
    assert shown().data.attributes.active_color_name == Attribute.PREVIEW_COLOR


@pytest.mark.parametrize(
    ("engine", "shading", "form"),
    [("CYCLES", "RENDERED", Form.INSTANCES), ("CYCLES", "MATERIAL", Form.PREVIEW), ("EEVEE", "RENDERED", Form.PREVIEW)],
)
def test_the_form_follows_the_shading_where_blender_would_not_stand_still(view, engine, shading, form):
    scene = bpy.context.scene
    name = next(name for name in ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT") if name in engines(scene))
    scene.render.engine = engine if engine == "CYCLES" else name
    view.shading.type = shading
    preview.follow_shading(scene, [view])
    assert form_of(shown()) is form
    view.shading.type = "SOLID"
    view.shading.color_type = "MATERIAL"
    preview.follow_shading(scene, [view])
    assert form_of(shown()) is Form.PREVIEW


def engines(scene) -> list[str]:
    try:
        scene.render.engine = ""
    except TypeError as error:
        return str(error).split("'")
    return []


def test_looking_around_lowers_the_budget_until_it_ends(view):
    splats.set_input(shown(), Input.BUDGET, 123_456)
    preview.look_around(bpy.context.scene, view)
    assert form_of(shown()) is Form.INSTANCES
    assert view.shading.type == "MATERIAL"
    assert splats.get_input(shown(), Input.BUDGET) == preview.LOOK_AROUND_BUDGET
    view.shading.type = "SOLID"
    preview.follow_shading(bpy.context.scene, [view])
    assert splats.get_input(shown(), Input.BUDGET) == 123_456


def test_looking_around_without_a_card_ends_where_the_file_is_opened_with_one(view, tmp_path, monkeypatch):
    file = str(tmp_path / "looking.blend")
    splats.set_input(shown(), Input.BUDGET, 123_456)
    preview.look_around(bpy.context.scene, view)
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)
    assert splats.get_input(shown(), Input.BUDGET) == preview.LOOK_AROUND_BUDGET
    monkeypatch.setattr(registration, "has_graphics_card", lambda: True)
    bpy.ops.wm.open_mainfile(filepath=file)
    assert splats.get_input(shown(), Input.BUDGET) == 123_456


def test_a_form_that_was_chosen_stays(view):
    bpy.ops.cvdgs.show_form(form="POINTS")
    assert not bpy.context.scene.cvdgs.display.automatic
    preview.follow_shading(bpy.context.scene, [view])
    assert form_of(shown()) is Form.POINTS


# ------------------------------------------------------------------------------------------------------------- the cube


def test_the_untouched_cube_is_hidden(view):
    cube = bpy.context.scene.objects["Cube"]
    assert cube.hide_get()
    assert cube.hide_render
    assert bystanders(bpy.context.scene) == []


@pytest.mark.parametrize("touched", ["moved", "edited", "material", "modifier", "renamed"])
def test_a_cube_that_somebody_touched_stays_and_can_be_hidden(addon, touched):
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    cube = scene.objects["Cube"]
    if touched == "moved":
        cube.location.x = 3.0
        bpy.context.view_layer.update()
    elif touched == "edited":
        cube.data.vertices[0].co.x = 2.0
    elif touched == "material":
        cube.data.materials[0] = bpy.data.materials.new("Oak")
    elif touched == "modifier":
        cube.modifiers.new("Bevel", "BEVEL")
    else:
        cube.data.name = "Table"
    assert not hide_start_cube(scene)
    assert not cube.hide_render
    hide(scene, bystanders(scene))
    assert cube.hide_render
    assert cube.hide_get()
