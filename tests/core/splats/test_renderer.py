"""Renderings of a scene from its capture's cameras."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import PinholeCamera, View
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer

from .training.test_trainer import BLACK, look_at, wall


def test_a_panorama_is_drawn_however_small_its_unit_is():
    """Its cameras share a centre, so that only the scene itself tells what is near."""
    camera = PinholeCamera(96, 72, 100.0, 100.0, 48.0, 36.0)
    scene = wall(400)
    small = replace(scene, means=scene.means * np.float32(1e-3), log_scales=scene.log_scales + np.float32(np.log(1e-3)))
    poses = [look_at(np.zeros(3), [x, 100.0, 0.0]) for x in (-4.0, 0.0, 4.0)]
    views = [
        View(f"{i}", Path(f"{i}.png"), camera, pose, np.zeros((72, 96, 3), np.uint8)) for i, pose in enumerate(poses)
    ]
    renderer = SceneRenderer(Rasterizer("cpu"), views, BLACK)
    np.testing.assert_allclose(renderer.color(small, 1), renderer.color(scene, 1), atol=1)
    depth, alpha = renderer.depth(small, 1)
    assert np.median(depth[alpha > 0.9]) == pytest.approx(0.1, abs=0.002)


@pytest.mark.parametrize("away", [8_000.0, 80_000.0])
def test_a_view_is_drawn_the_same_however_far_another_camera_is(away):
    """A photograph with a wrong place must not move the near plane behind what the others show."""
    camera = PinholeCamera(96, 72, 100.0, 100.0, 48.0, 36.0)
    scene = wall(400)
    poses = [look_at(np.array([x, 0.0, 0.0]), [0.0, 100.0, 0.0]) for x in (-40.0, 0.0, 40.0)]
    views = [
        View(f"{i}", Path(f"{i}.png"), camera, pose, np.zeros((72, 96, 3), np.uint8)) for i, pose in enumerate(poses)
    ]
    lost = replace(views[0], world_to_camera=look_at(np.array([-away, 0.0, 0.0]), [0.0, 100.0, 0.0]))
    alone, beside = (SceneRenderer(Rasterizer("cpu"), given, BLACK) for given in (views, [*views, lost]))
    assert alone.color(scene, 1).any()
    np.testing.assert_allclose(beside.color(scene, 1), alone.color(scene, 1), atol=1)
