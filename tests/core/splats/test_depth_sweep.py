"""The depth sweep finds the surfaces that photographs show, and gives up gracefully where they show none."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.capture.model import View
from cvdgs.core.splats.depth_sweep import DepthSweep
from cvdgs.core.splats.scene_frame import SceneFrame

from .test_initialise import NO_POINTS, ring_of_views

CENTRE = np.array([5.0, -2.0, 1.0])
RADIUS = 1.0  # of the ball
COUNT = 400


def ball_of_many_colours(size: int = 96) -> list[View]:
    """A ball whose colour is a function of the place on it, in front of black."""
    views = []
    for view in ring_of_views(count=12, radius=3.0, centre=CENTRE, size=size):
        camera, rotation = view.camera, view.world_to_camera[:3, :3]
        y, x = np.mgrid[:size, :size] + 0.5
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1) @ rotation
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        towards = CENTRE - view.center
        along = rays @ towards
        inside = along**2 - towards @ towards + RADIUS**2
        place = view.center + rays * (along - np.sqrt(np.maximum(inside, 0.0)))[..., None] - CENTRE
        colors = 127.5 + 127.5 * np.sin(4.0 * place + np.array([0.0, 1.0, 2.0]))
        image = np.where(inside[..., None] > 0.0, colors, 0.0).astype(np.uint8)
        views.append(replace(view, image=image, alpha=np.where(inside > 0.0, 255, 0).astype(np.uint8)))
    return views


def swept(views: list[View], known: np.ndarray = NO_POINTS[0], **options) -> tuple[np.ndarray, np.ndarray]:
    """(N,) distances from the ball's centre in world units, and the (N, 3) colours that were found."""
    frame = SceneFrame.around(views, known)
    means, colors = DepthSweep(**options).sample(views, frame.points(known), frame, COUNT, np.random.default_rng(0))
    world = means / frame.scale + frame.origin
    return np.linalg.norm(world - CENTRE, axis=1), colors


def on_the_ball(count: int) -> np.ndarray:
    directions = np.random.default_rng(1).standard_normal((count, 3))
    return (CENTRE + RADIUS * directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


@pytest.fixture(scope="module")
def views():
    return ball_of_many_colours()


@pytest.mark.parametrize("known", [0, 20, 200])
def test_pixels_are_put_where_the_surface_is(views, known):
    distances, colors = swept(views, on_the_ball(known))
    assert np.median(np.abs(distances - RADIUS)) < 0.1 * RADIUS
    assert colors.min() >= 0.0
    assert 0.5 < colors.max() <= 1.0


def test_only_what_is_covered_is_taken(views):
    distances, colors = swept(views)
    assert len(distances) == COUNT
    assert colors.max(axis=1).min() > 0.0  # black is beside the ball


def test_empty_photographs_give_nothing(views):
    assert len(swept([replace(view, alpha=np.zeros_like(view.image[..., 0])) for view in views])[0]) == 0


def test_where_colours_say_nothing_known_points_do():
    views = [replace(view, image=np.full_like(view.image, 90)) for view in ball_of_many_colours()]
    guided, unguided = swept(views, on_the_ball(200))[0], swept(views)[0]
    assert np.median(np.abs(guided - RADIUS)) < 0.1 * RADIUS
    assert np.median(np.abs(unguided - RADIUS)) > 0.2 * RADIUS


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_views_give_finite_places_in_front_of_them(views, count):
    frame = SceneFrame.around(views[:count], NO_POINTS[0])
    sampled = DepthSweep().sample(views[:count], *NO_POINTS[:1], frame, COUNT, np.random.default_rng(0))
    means = sampled[0]
    assert len(means)
    assert np.isfinite(means).all()
    pose = frame.world_to_camera(views[0].world_to_camera)
    if count == 1:
        assert (means @ pose[2, :3] + pose[2, 3] > 0.0).all()


def test_large_photographs_are_compared_small(views):
    fine, coarse = swept(views)[0], swept(views, side=48)[0]
    assert np.median(np.abs(coarse - RADIUS)) < 3.0 * np.median(np.abs(fine - RADIUS)) + 0.05
