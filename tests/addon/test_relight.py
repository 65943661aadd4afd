"""Relighting Gaussians: which way they face, what a lamp multiplies their light by, and that it can be taken back."""

from __future__ import annotations

import bpy
import mathutils
import numpy as np
import pytest

from cvdgs.core.color import srgb
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.cvdgs_addon.results import show_run
from cvdgs.cvdgs_addon.scene import relight, splats
from cvdgs.cvdgs_addon.scene.normals import store_normals, surface_normals
from cvdgs.cvdgs_addon.scene.relight_nodes import FACING, TURNED_AWAY
from cvdgs.cvdgs_addon.scene.shapes import covariances
from cvdgs.cvdgs_addon.scene.splat_attributes import Attribute, read_attribute
from cvdgs.cvdgs_addon.scene.splat_nodes import Input
from cvdgs.ui.display import CVDGS_PT_display

from .layouts import drawn
from .scenes import drawn_points


def ball(count: int = 3000, grey: float = 0.3, *, specks: bool = False) -> Gaussians:
    """Flat Gaussians on the unit sphere; `specks`: round ones, whose own axes say nothing."""
    random = np.random.default_rng(5)
    normals = random.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    flat = np.column_stack([1.0 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(count)])  # takes z there
    scales = [0.01, 0.01, 0.01] if specks else [0.05, 0.04, 0.005]
    return Gaussians(
        means=normals.astype(np.float32),
        log_scales=np.log(np.tile(scales, (count, 1))).astype(np.float32),
        quaternions=(random.standard_normal((count, 4)) if specks else flat).astype(np.float32),
        opacity_logits=np.full(count, 3.0, np.float32),
        sh=np.full((count, 1, 3), (srgb.encode(grey) - 0.5) / SH_C0, np.float32),
    )


def lamp_towards(scene: bpy.types.Scene, direction: tuple[float, float, float]) -> bpy.types.Object:
    """A sun that shines from there."""
    lamp = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    lamp.rotation_euler = mathutils.Vector(direction).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(lamp)
    bpy.context.view_layer.update()
    return lamp


def brightness(added: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Positions, and the light of what is drawn there."""
    splats.set_input(added, Input.AS_POINTS, True)
    bpy.context.view_layer.update()
    positions, colors = drawn_points(added)
    return positions, srgb.decode(colors.mean(axis=1))


def degrees_off(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(np.abs((found * true).sum(axis=1)), 0.0, 1.0)))


@pytest.mark.parametrize("specks", [False, True], ids=["flat", "specks"])
def test_normals_of_a_ball_point_from_its_middle(scene, specks):
    added = splats.add_gaussians(ball(specks=specks), {}, scene.collection)
    store_normals(added)
    normals = read_attribute(added.data, Attribute.NORMAL)[:3000]
    true = ball(specks=specks).means
    assert np.median(degrees_off(normals, true)) < 5.0
    assert ((normals * true).sum(axis=1) > 0.0).all(), "outwards, where there are no cameras"


def test_gaussians_far_away_do_not_disturb_the_others(scene):
    gaussians = ball()
    gaussians.means[:3] *= 1e7
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    shapes = covariances(added.data)
    found = surface_normals(gaussians.means.astype(np.float64), shapes, gaussians.opacities)
    assert np.median(degrees_off(found[3:], gaussians.means[3:])) < 5.0


def test_a_lamp_multiplies_the_light_by_the_way_that_a_surface_faces(scene):
    added = splats.add_gaussians(ball(grey=0.3), {}, scene.collection)
    towards = np.array([0.6, 0.0, 0.8])
    relight.relight(added, scene, lamp_towards(scene, tuple(towards)))
    positions, light = brightness(added)
    expected = 0.3 * (TURNED_AWAY + FACING * np.maximum(positions @ towards, 0.0))
    assert np.median(np.abs(light - expected)) < 0.02


@pytest.mark.parametrize("applied", [False, True], ids=["object turned", "turn applied"])
def test_the_lamp_stays_where_it_is_when_the_gaussians_are_turned(scene, applied):
    added = splats.add_gaussians(ball(grey=0.3), {}, scene.collection)
    lamp = lamp_towards(scene, (1.0, 0.0, 0.0))
    relight.relight(added, scene, lamp)
    turn = mathutils.Euler((0.4, 0.3, 1.2)).to_matrix().to_4x4()
    if applied:
        added.data.transform(turn)
        added.data.update()
    else:
        added.matrix_basis = turn
    bpy.context.view_layer.update()
    positions, light = brightness(added)
    if not applied:
        positions = positions @ np.array(turn)[:3, :3].T
    assert light[positions[:, 0] > 0.9].mean() == pytest.approx(0.3 * (TURNED_AWAY + FACING), rel=0.05)
    assert light[positions[:, 0] < -0.1].mean() == pytest.approx(0.3 * TURNED_AWAY, rel=0.05)


def test_half_the_amount_is_half_of_the_change_and_none_is_the_photographs(scene):
    added = splats.add_gaussians(ball(grey=0.3), {}, scene.collection)
    _, before = brightness(added)
    relight.relight(added, scene, lamp_towards(scene, (0.0, 0.0, 1.0)))
    _, full = brightness(added)
    splats.set_input(added, Input.RELIGHT, 0.5)
    _, half = brightness(added)
    np.testing.assert_allclose(half, (before + full) / 2.0, atol=1e-3)
    splats.set_input(added, Input.RELIGHT, 0.0)
    _, none = brightness(added)
    np.testing.assert_array_equal(none, before)


def test_new_gaussians_are_not_relit_and_hold_no_normals(scene):
    added = splats.add_gaussians(ball(50), {}, scene.collection)
    assert splats.get_input(added, Input.RELIGHT) == 0.0
    assert Attribute.NORMAL not in added.data.attributes


def test_the_buttons_relight_by_the_active_lamp_or_a_new_one_and_take_it_back(addon, run_folder):
    shown = show_run(str(run_folder), bpy.context.scene)
    assert not bpy.ops.cvdgs.take_light_back.poll()
    bpy.context.view_layer.objects.active = shown
    bpy.ops.cvdgs.relight()
    assert relight.lamp_of(shown).name == relight.LAMP_NAME
    assert "Rotate the lamp." in " ".join(drawn(CVDGS_PT_display).texts)
    own = lamp_towards(bpy.context.scene, (0.0, 1.0, 1.0))
    bpy.context.view_layer.objects.active = own
    bpy.ops.cvdgs.relight()
    assert relight.lamp_of(shown) == own
    bpy.ops.cvdgs.take_light_back()
    assert not relight.is_relit(shown)
    assert splats.get_input(shown, Input.RELIGHT) == 0.0
