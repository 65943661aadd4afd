"""The light of the photographs: its direction, colour and strength, and what renders of lit objects need."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cvdgs.core.color import srgb
from cvdgs.core.errors import InputError
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.cvdgs_addon.scene import display, splats
from cvdgs.cvdgs_addon.scene.estimated_light import LIGHT_NAME, add_estimated_light, estimate_light
from cvdgs.cvdgs_addon.scene.render_settings import Display, Engine

from .scenes import cloud

AMBIENT, DIRECT = 0.35, 0.3
WARM = np.array([1.0, 0.9, 0.75])


def lit_ball(light: np.ndarray, count: int = 2000) -> Gaussians:
    """Flat Gaussians on a ball, half of them white and half of any colour, under a soft light."""
    random = np.random.default_rng(3)
    normals = random.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # The shortest rotation that takes z to the normal.
    quaternions = np.column_stack([1.0 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(count)])
    albedo = np.where(random.random(count)[:, None] < 0.5, 1.0, random.uniform(0.1, 1.0, (count, 3)))
    colors = srgb.encode(np.clip(albedo * WARM * (AMBIENT + DIRECT * normals @ light)[:, None], 0.0, 1.0))
    return Gaussians(
        means=normals.astype(np.float32),
        log_scales=np.log(np.tile([0.05, 0.04, 0.005], (count, 1))).astype(np.float32),
        quaternions=quaternions.astype(np.float32),
        opacity_logits=np.full(count, 3.0, np.float32),
        sh=((colors - 0.5) / SH_C0).astype(np.float32)[:, None, :],
    )


def test_direction_colour_and_strength_are_those_of_the_light(scene):
    light = np.array([0.6, -0.48, 0.64])
    added = splats.add_gaussians(lit_ball(light), {}, scene.collection)
    bpy.context.view_layer.update()
    found = estimate_light(added)
    assert np.degrees(np.arccos(found.direction @ light)) < 8.0
    np.testing.assert_allclose(found.color, WARM / WARM.max(), atol=0.05)
    assert found.direct / found.ambient == pytest.approx(DIRECT / AMBIENT, rel=0.15)
    assert found.direct + found.ambient == pytest.approx(AMBIENT + DIRECT, rel=0.2)


def test_the_direction_turns_with_the_gaussians(scene):
    light = np.array([1.0, 0.0, 0.0])
    added = splats.add_gaussians(lit_ball(light), {}, scene.collection)
    added.rotation_euler = (0.0, 0.0, np.pi / 2)
    bpy.context.view_layer.update()
    assert estimate_light(added).direction[1] > 0.98


def test_two_lamps_are_added_once(scene):
    light = np.array([0.6, -0.48, 0.64])
    added = splats.add_gaussians(lit_ball(light), {}, scene.collection)
    bpy.context.view_layer.update()
    add_estimated_light(added, scene)
    key, fill = add_estimated_light(added, scene)
    bpy.context.view_layer.update()
    assert [lamp.name for lamp in scene.objects if lamp.type == "LIGHT"] == [LIGHT_NAME, f"{LIGHT_NAME}, Fill"]
    shining = -np.array(key.matrix_world.to_3x3())[:, 2]  # lamps shine along their -z
    assert np.degrees(np.arccos(-shining @ light)) < 8.0
    assert fill.data.angle == pytest.approx(np.pi)


def test_linked_duplicates_of_the_lamps_are_replaced_with_them(scene):
    added = splats.add_gaussians(lit_ball(np.array([0.6, -0.48, 0.64])), {}, scene.collection)
    for lamp in add_estimated_light(added, scene):
        scene.collection.objects.link(lamp.copy())
    lamps = add_estimated_light(added, scene)
    assert [found for found in scene.objects if found.type == "LIGHT"] == lamps


def test_too_few_flat_gaussians_are_refused(scene):
    gaussians = cloud(30)
    gaussians.log_scales[:] = -2.0
    added = splats.add_gaussians(gaussians, {}, scene.collection)
    with pytest.raises(InputError, match="too few flat Gaussians"):
        estimate_light(added)


def test_lit_objects_get_samples_and_bounces_and_gaussians_alone_do_not(scene):
    display.set_up_render(scene, Engine.CYCLES, Display.SCENE_LINEAR)
    assert scene.cycles.samples >= 64
    assert scene.cycles.max_bounces >= 2
    assert scene.cycles.use_adaptive_sampling
    assert not scene.cycles.use_denoising
    display.set_up_render(scene, Engine.CYCLES, Display.PHOTO)
    assert (scene.cycles.samples, scene.cycles.max_bounces) == (1, 0)
