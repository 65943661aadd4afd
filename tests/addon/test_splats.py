"""Gaussians in Blender: their pixels against an independent rasteriser, and the object that carries them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import bmesh
import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.runs.layout import ORIGINAL
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.cvdgs_addon.scene import render_settings, splats
from cvdgs.cvdgs_addon.scene.drawing_nodes import DISC_CORNERS
from cvdgs.cvdgs_addon.scene.splat_attributes import Attribute
from cvdgs.cvdgs_addon.scene.splat_nodes import Input

from ..effort import function_calls
from . import ewa
from .scenes import (
    CAMERA,
    cloud,
    look_through,
    opencv,
    render_png,
    ring_view,
    take,
)

POSE = ring_view(0.4)
QUANTISATION = 0.5 / 255.0  # largest error that 8-bit output makes


def reference(gaussians: Gaussians, colors=None, **options) -> np.ndarray:
    colors = gaussians.base_colors if colors is None else colors
    return ewa.render(gaussians, colors, CAMERA, opencv(POSE), **options)


@pytest.fixture(autouse=True)
def view(scene):
    return look_through(scene, CAMERA, POSE)


@pytest.mark.parametrize("limit", [0, 500], ids=["instances", "mesh"])
def test_a_render_is_the_rasterisers_image(scene, tmp_path, limit):
    gaussians = cloud(500)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    splats.set_input(added, Input.MESH_LIMIT, limit)
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), reference(gaussians)) > 50.0


def test_the_low_pass_follows_the_resolution_and_the_lens(scene, view, tmp_path):
    gaussians = cloud(150, size=0.02)
    splats.add_gaussians(gaussians, {}, scene.collection)
    view.data.lens *= 0.5
    scene.render.resolution_percentage = 200
    camera = type(CAMERA)(128, 96, CAMERA.fx, CAMERA.fy, 2 * CAMERA.cx, 2 * CAMERA.cy)
    expected = ewa.render(gaussians, gaussians.base_colors, camera, opencv(POSE))
    image = render_png(scene, tmp_path / "image.png")
    assert ewa.psnr(image, expected) > 50.0
    assert ewa.psnr(image, ewa.render(gaussians, gaussians.base_colors, camera, opencv(POSE), dilation=0.0)) < 40.0


def test_a_background_shines_through(scene, tmp_path):
    gaussians = cloud(60)
    splats.add_gaussians(gaussians, {}, scene.collection)
    render_settings.set_background(scene, (0.2, 0.5, 0.9))
    image = render_png(scene, tmp_path / "image.png")
    assert ewa.psnr(image, reference(gaussians, background=(0.2, 0.5, 0.9))) > 50.0


def test_gaussians_that_touch_the_camera_do_no_harm(scene, tmp_path):
    gaussians = cloud(200)
    gaussians.means[:40] = POSE[:3, 3] + np.random.default_rng(1).normal(0.0, 0.3, (40, 3))
    splats.add_gaussians(gaussians, {}, scene.collection)
    image = render_png(scene, tmp_path / "image.png")
    # Discs nearer than the camera's clip start (0.05) are not drawn; the reference starts at 0.01.
    depths = opencv(POSE) @ np.c_[gaussians.means, np.ones(200)].T
    shown = take(gaussians, np.flatnonzero(depths[2] > 0.05))
    assert ewa.psnr(image, reference(shown)) > 45.0


@pytest.mark.parametrize("enhanced", [0.0, 0.3, 1.0])
def test_the_slider_blends_original_and_layer(scene, tmp_path, enhanced):
    gaussians = cloud(150)
    layer = 1.0 - gaussians.base_colors
    added = splats.add_gaussians(gaussians, {"deutan-1.0": layer}, scene.collection)
    splats.show_layer(added, "deutan-1.0", enhanced)
    expected = reference(gaussians, (1.0 - enhanced) * gaussians.base_colors + enhanced * layer)
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), expected) > 50.0


def test_the_slider_can_be_animated(scene, tmp_path):
    gaussians = cloud(100)
    added = splats.add_gaussians(gaussians, {"deutan-1.0": 1.0 - gaussians.base_colors}, scene.collection)
    for frame, value in ((1, 0.0), (2, 1.0)):
        splats.set_input(added, Input.ENHANCED, value)
        added.keyframe_insert(splats.input_path(added, Input.ENHANCED), frame=frame)
    scene.frame_set(1)
    assert ewa.psnr(render_png(scene, tmp_path / "1.png"), reference(gaussians)) > 50.0
    scene.frame_set(2)
    assert ewa.psnr(render_png(scene, tmp_path / "2.png"), reference(gaussians, 1.0 - gaussians.base_colors)) > 50.0


def test_scene_linear_colours_come_back_through_the_standard_view(scene, tmp_path):
    """Where a Gaussian is opaque there is nothing to blend, so that both ways show the photograph's colour."""
    color = (0.8, 0.31, 0.1)
    splat = one_gaussian(color, scale=0.6, opacity_logit=9.0)
    added = splats.add_gaussians(splat, {}, scene.collection)
    splats.set_input(added, Input.SCENE_LINEAR, True)
    render_settings.set_display(scene, render_settings.Display.SCENE_LINEAR)
    image = render_png(scene, tmp_path / "image.png")
    np.testing.assert_allclose(image[int(CAMERA.cy), int(CAMERA.cx)], color, atol=2.0 / 255.0)


@pytest.mark.parametrize("facing", [True, False])
def test_either_hull_draws_a_single_gaussian_alike(scene, tmp_path, facing):
    """The two differ by perspective within a Gaussian and by order between them, so not for a small one alone."""
    splat = one_gaussian((0.2, 0.9, 0.4), scale=0.15, opacity_logit=2.0)
    added = splats.add_gaussians(splat, {}, scene.collection)
    splats.set_input(added, Input.CAMERA_FACING, facing)
    assert np.abs(render_png(scene, tmp_path / "image.png") - reference(splat)).max() < (0.5 if facing else 3.0) / 255.0


def drawn_in_the_viewport() -> set[int]:
    """Corners of the hulls that the viewport's evaluation of the scene has as instances."""
    instances = bpy.context.evaluated_depsgraph_get().object_instances
    return {len(instance.object.data.vertices) for instance in instances if instance.is_instance}


class Meshed(NamedTuple):
    """The mesh of hulls that the viewport's evaluation of an object has."""

    corners: int
    centers: np.ndarray
    attributes: set[str]


def meshed_in_the_viewport(added: bpy.types.Object) -> Meshed:
    geometry = added.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    centers = np.array([polygon.center.to_tuple() for polygon in geometry.mesh.polygons])
    return Meshed(len(geometry.mesh.vertices), centers, set(geometry.mesh.attributes.keys()))


@pytest.mark.parametrize("limit", [0, 20], ids=["instances", "mesh"])
def test_the_viewport_draws_ellipsoids_unless_it_looks_through_the_camera(scene, limit):
    added = splats.add_gaussians(cloud(20), {}, scene.collection)
    splats.set_input(added, Input.MESH_LIMIT, limit)
    (ellipsoid,) = drawn_in_the_viewport()
    assert ellipsoid > DISC_CORNERS
    splats.set_input(added, Input.CAMERA_VIEW, True)
    if limit:
        assert drawn_in_the_viewport() == set()
        assert meshed_in_the_viewport(added).corners == 20 * DISC_CORNERS
    else:
        assert drawn_in_the_viewport() == {DISC_CORNERS}


def test_what_is_drawn_counts_for_the_mesh_and_not_what_there_is(scene):
    added = splats.add_gaussians(cloud(20), {}, scene.collection)
    splats.set_input(added, Input.CAMERA_VIEW, True)
    splats.set_input(added, Input.MESH_LIMIT, 19)
    assert drawn_in_the_viewport() == {DISC_CORNERS}
    splats.set_input(added, Input.BUDGET, 19)
    assert drawn_in_the_viewport() == set()
    assert len(meshed_in_the_viewport(added).centers) == 19


@pytest.mark.parametrize("degree", [0, 2])
def test_the_mesh_carries_only_what_is_shown(scene, degree):
    """Attributes take memory for each corner of each disc."""
    sh = np.zeros((20, (degree + 1) ** 2, 3), np.float32)
    gaussians = replace(cloud(20), sh=sh)
    added = splats.add_gaussians(gaussians, {"deutan-1.0": gaussians.base_colors}, scene.collection)
    splats.set_input(added, Input.CAMERA_VIEW, True)
    kept = meshed_in_the_viewport(added).attributes
    shown = {Attribute.ON_DISC, Attribute.OPACITY, Attribute.DRAWN_COLOR}
    assert kept >= shown
    names = [attribute.name for attribute in added.data.attributes]
    others = {name for name in names if not name.startswith(".")} - shown - {"position"}
    assert others >= {Attribute.SCALE, "color_deutan-1.0"}
    assert not kept & others


def test_the_mesh_has_the_farthest_discs_first(scene):
    """The order in which EEVEE draws them."""
    added = splats.add_gaussians(cloud(50), {}, scene.collection)
    splats.set_input(added, Input.CAMERA_VIEW, True)
    centers = meshed_in_the_viewport(added).centers
    depths = (centers @ opencv(POSE)[:3, :3].T + opencv(POSE)[:3, 3])[:, 2]
    assert len(depths) == 50
    assert (np.diff(depths) < 1e-5).all()


def test_motion_blur_needs_instances(scene):
    """The faces of the mesh change places as the camera moves, so that blur would join those of different discs."""
    added = splats.add_gaussians(cloud(20), {}, scene.collection)
    splats.set_input(added, Input.CAMERA_VIEW, True)
    assert drawn_in_the_viewport() == set()
    scene.render.use_motion_blur = True
    assert drawn_in_the_viewport() == {DISC_CORNERS}


def test_an_orthographic_camera_shows_ellipsoids(scene, view, tmp_path):
    splat = one_gaussian((1.0, 1.0, 1.0), scale=0.2, opacity_logit=2.0)
    added = splats.add_gaussians(splat, {}, scene.collection)
    splats.set_input(added, Input.DILATION, 0.0)
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0
    view.data.type, view.data.ortho_scale = "ORTHO", 3.0
    view.data.shift_x = view.data.shift_y = 0.0
    image = render_png(scene, tmp_path / "image.png")
    columns, rows = np.meshgrid(np.arange(64) + 0.5 - 32, np.arange(48) + 0.5 - 24)
    radius = np.hypot(columns, rows) * 3.0 / 64 / 0.2
    expected = np.exp(-0.5 * radius**2) * splat.opacities[0]
    expected[expected < 1 / 255] = 0.0
    assert np.abs(image[..., 0] - expected).max() < 2.0 / 255.0


def test_moving_the_object_moves_the_picture(scene, tmp_path):
    """Object, camera and capture may all be moved: only how they stand to each other counts."""
    gaussians = cloud(200)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    move = mathutils.Matrix.LocRotScale((3.0, -1.0, 2.0), mathutils.Euler((0.3, 0.2, 1.0)), (2.0, 2.0, 2.0))
    added.matrix_world = move
    scene.camera.matrix_world = move @ mathutils.Matrix(POSE.tolist())
    scene.camera.data.clip_start *= 2.0
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), reference(gaussians)) > 50.0


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_colours_that_depend_on_the_direction_are_seen_so(scene, tmp_path, degree):
    """Also from an object that was turned and applied: the coefficients stay in the axes of the PLY."""
    sh = np.random.default_rng(degree).normal(0.0, 0.3, (200, (degree + 1) ** 2, 3)).astype(np.float32)
    gaussians = replace(cloud(200), sh=sh)
    layer = cloud(200, seed=5).base_colors
    added = splats.add_gaussians(gaussians, {"deutan-1.0": layer}, scene.collection)
    turn = mathutils.Euler((0.4, 0.0, 1.0)).to_matrix().to_4x4()
    added.matrix_world = turn
    apply_transform(added)
    scene.camera.matrix_world = turn @ mathutils.Matrix(POSE.tolist())
    expected = ewa.seen_colors(gaussians, POSE[:3, 3])
    assert np.abs(expected - ewa.seen_colors(gaussians, -POSE[:3, 3])).max() > 0.2
    splats.show_layer(added, ORIGINAL)
    image = render_png(scene, tmp_path / "original.png")
    assert ewa.psnr(image, reference(gaussians, expected).clip(0.0, 1.0)) > 50.0
    splats.show_layer(added, "deutan-1.0")
    assert ewa.psnr(render_png(scene, tmp_path / "layer.png"), reference(gaussians, layer)) > 50.0


@pytest.mark.parametrize("scale", [(1.7, 1.7, 1.7), (0.5, 1.0, 1.5)])
def test_applying_the_transform_changes_nothing(scene, tmp_path, scale):
    added = splats.add_gaussians(cloud(200), {}, scene.collection)
    added.matrix_world = mathutils.Matrix.LocRotScale((0.2, 0.1, -0.3), mathutils.Euler((0.7, -0.4, 0.2)), scale)
    before = render_png(scene, tmp_path / "before.png")
    apply_transform(added)
    assert added.matrix_world == mathutils.Matrix.Identity(4)
    # Rounding may swap two Gaussians of the same depth in a few pixels.
    assert ewa.psnr(render_png(scene, tmp_path / "after.png"), before) > 50.0


@pytest.mark.parametrize("scale", [0.2, 5.0])
def test_gaussians_from_any_side_are_as_sharp_in_a_resized_object(scene, tmp_path, scale):
    """The low-pass of ellipsoids is one of pixels, whatever a unit of the object is in the scene."""
    gaussians = cloud(150, size=0.02)
    smaller = replace(gaussians, means=gaussians.means / scale, log_scales=gaussians.log_scales - np.log(scale))
    pictures = []
    for shown, resized in ((gaussians, 1.0), (smaller, scale)):
        added = splats.add_gaussians(shown, {}, scene.collection)
        splats.set_input(added, Input.CAMERA_FACING, False)
        added.scale = (resized,) * 3
        pictures.append(render_png(scene, tmp_path / f"{resized}.png"))
        bpy.data.objects.remove(added)
    assert pictures[0].max() > 0.1
    assert ewa.psnr(*pictures) > 45.0


def test_deleting_points_deletes_gaussians(scene, tmp_path):
    gaussians = cloud(100)
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    edited = bmesh.new()
    edited.from_mesh(added.data)
    edited.verts.ensure_lookup_table()
    bmesh.ops.delete(edited, geom=edited.verts[:50], context="VERTS")
    edited.to_mesh(added.data)
    edited.free()
    kept = take(gaussians, range(50, 100))
    assert ewa.psnr(render_png(scene, tmp_path / "image.png"), reference(kept)) > 50.0


def test_saving_and_loading_keeps_everything(scene, tmp_path):
    gaussians = cloud(200)
    layer = 1.0 - gaussians.base_colors
    added = splats.add_gaussians(gaussians, {"protan-0.6": layer, "deutan-1.0": layer}, scene.collection)
    splats.show_layer(added, "deutan-1.0", 0.25)
    before = render_png(scene, tmp_path / "before.png")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    loaded = next(candidate for candidate in bpy.data.objects if splats.is_splats(candidate))
    assert splats.layer_names(loaded) == [ORIGINAL, "protan-0.6", "deutan-1.0"]
    assert splats.get_input(loaded, Input.ENHANCED) == 0.25
    values = np.empty(len(loaded.data.vertices), np.float32)
    loaded.data.attributes[Attribute.OPACITY].data.foreach_get("value", values)
    np.testing.assert_array_equal(values[:200], gaussians.opacities)
    np.testing.assert_array_equal(render_png(bpy.context.scene, tmp_path / "after.png"), before)


def test_two_objects_share_one_node_group_but_not_their_settings(scene):
    first = splats.add_gaussians(cloud(10), {}, scene.collection)
    second = splats.add_gaussians(cloud(10, seed=1), {}, scene.collection)
    splats.set_input(second, Input.ENHANCED, 0.5)
    groups = [added.modifiers[splats.MODIFIER_NAME].node_group for added in (first, second)]
    assert groups[0] == groups[1]
    assert splats.get_input(first, Input.ENHANCED) == 1.0
    assert not splats.is_splats(scene.camera)


def test_a_node_group_of_an_earlier_release_stays_with_the_gaussians_that_have_it(scene, tmp_path):
    earlier = splats.add_gaussians(cloud(10), {}, scene.collection)
    group = earlier.modifiers[splats.MODIFIER_NAME].node_group
    items = group.interface.items_tree
    group.interface.remove(next(item for item in items if item.name == Input.MOTION_BLUR))
    later, latest = (splats.add_gaussians(cloud(10), {}, scene.collection) for _ in range(2))
    assert earlier.modifiers[splats.MODIFIER_NAME].node_group == group
    assert later.modifiers[splats.MODIFIER_NAME].node_group != group
    assert later.modifiers[splats.MODIFIER_NAME].node_group == latest.modifiers[splats.MODIFIER_NAME].node_group
    assert splats.is_splats(earlier)
    assert splats.is_splats(latest)


def test_every_input_of_the_node_group_is_documented(scene):
    added = splats.add_gaussians(cloud(3), {}, scene.collection)
    items = added.modifiers[splats.MODIFIER_NAME].node_group.interface.items_tree
    inputs = {item.name: item.description for item in items if item.in_out == "INPUT"}
    assert set(inputs) == {"Geometry", *Input}
    assert all(inputs.values())


def test_unusable_gaussians_are_refused(scene):
    with pytest.raises(InputError, match="no Gaussians"):
        splats.add_gaussians(take(cloud(3), []), {}, scene.collection)
    broken = cloud(3)
    broken.means[1, 2] = np.nan
    with pytest.raises(InputError, match="positions are not finite"):
        splats.add_gaussians(broken, {}, scene.collection)
    with pytest.raises(InputError, match="2 colours for 3"):
        splats.add_gaussians(cloud(3), {"deutan-1.0": np.zeros((2, 3), np.float32)}, scene.collection)
    with pytest.raises(InputError, match=r"no colour layer .protan-1\.0."):
        splats.show_layer(splats.add_gaussians(cloud(3), {}, scene.collection), "protan-1.0")


def test_more_gaussians_take_no_more_calls(scene):
    def effort(count: int) -> int:
        gaussians = cloud(count, size=0.01)
        layers = {"deutan-1.0": gaussians.base_colors}
        return function_calls(lambda: splats.add_gaussians(gaussians, layers, scene.collection))

    effort(10)  # the first object brings the node groups
    assert effort(100_000) < 2 * effort(100)


def apply_transform(target: bpy.types.Object) -> None:
    with bpy.context.temp_override(active_object=target, object=target, selected_editable_objects=[target]):
        bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)


def one_gaussian(color, scale: float, opacity_logit: float) -> Gaussians:
    """A round Gaussian at the origin."""
    return Gaussians(
        means=np.zeros((1, 3), np.float32),
        log_scales=np.full((1, 3), np.log(scale), np.float32),
        quaternions=np.array([[1.0, 0.0, 0.0, 0.0]], np.float32),
        opacity_logits=np.array([opacity_logit], np.float32),
        sh=np.zeros((1, 1, 3), np.float32),
    ).with_base_colors(np.array([color], np.float32))
