"""Initialisation from points and by the depth sweep, and the frame in which a scene is trained."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.capture.model import PinholeCamera, View
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.training.initialise import DenseStart, DepthSweep, InitialGaussians

NO_POINTS = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
CENTRE = np.array([5.0, -2.0, 1.0])
RADIUS = 1.0  # of the ball
COUNT = 400


def ring_of_views(count=8, radius=3.0, centre=(0.0, 0.0, 0.0), size=64) -> list[View]:
    """Views on a circle around `centre`, looking at it."""
    views = []
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False):
        position = np.asarray(centre) + radius * np.array([np.cos(angle), np.sin(angle), 0.3])
        forward = np.asarray(centre) - position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ position
        image = np.full((size, size, 3), 100, np.uint8)
        views.append(
            View(f"{angle:.2f}", Path("x.png"), PinholeCamera(size, size, size, size, size / 2, size / 2), pose, image)
        )
    return views


def test_points_become_gaussians_of_their_colour_and_spacing():
    grid = np.stack(np.meshgrid(*[np.arange(11.0)] * 3), -1).reshape(-1, 3).astype(np.float32)
    views = ring_of_views(radius=100.0)
    frame = SceneFrame.around(views, grid)
    colors = np.full((len(grid), 3), 51, np.uint8)
    made = InitialGaussians().make(views, grid, colors, frame, np.random.default_rng(0), 3 * len(grid))
    world = frame.to_world(made)
    np.testing.assert_allclose(world.means, grid, atol=1e-4)
    np.testing.assert_allclose(np.exp(world.log_scales), 1.0, rtol=1e-3)
    np.testing.assert_allclose(made.base_colors, 0.2, atol=1e-6)
    np.testing.assert_allclose(made.opacities, 0.1, atol=1e-6)


@pytest.mark.parametrize(("points", "expected"), [(0, 1200), (300, 1200), (1100, 1100)])
def test_where_there_are_few_points_a_third_of_the_limit_is_made_up(points, expected):
    views = ring_of_views()
    given = np.random.default_rng(1).standard_normal((points, 3)).astype(np.float32)
    frame = SceneFrame.around(views, given)
    colors = np.zeros((points, 3), np.uint8)
    made = InitialGaussians().make(views, given, colors, frame, np.random.default_rng(0), 3600)
    assert len(made) == expected
    np.testing.assert_allclose(made.means[:points], frame.points(given))


def test_more_points_than_allowed_are_thinned():
    points = np.random.default_rng(1).standard_normal((4000, 3)).astype(np.float32)
    views = ring_of_views()
    made = InitialGaussians().make(
        views, points, np.zeros((4000, 3), np.uint8), SceneFrame.around(views, points), np.random.default_rng(0), 1500
    )
    assert len(made) == 1500


@given(st.integers(0, 100_000), st.integers(1, 100_000))
def test_dense_stereo_fills_half_of_the_limit_but_is_never_less_than_a_third_of_the_start(known, limit):
    missing = DenseStart().missing(known, limit)
    kept = min(known, limit - missing)
    assert 0 <= kept + missing <= limit
    assert missing >= (kept + missing) / 3 - 1
    assert kept + missing >= limit / 2 - 1


@pytest.mark.parametrize("degree", [0, 2])
def test_what_begins_again_is_faint_and_round_where_it_was_and_in_its_colours(degree):
    rng = np.random.default_rng(2)
    shapes = ((30, 3), (30, 3), (30, 4), (30,), (30, 1, 3))
    settled = Gaussians(*(rng.uniform(-1.0, 1.0, shape).astype(np.float32) for shape in shapes))
    settled = settled.with_sh_degree(degree)
    made = InitialGaussians().again(settled)
    np.testing.assert_array_equal(made.means, settled.means)
    np.testing.assert_allclose(made.base_colors, np.minimum(settled.base_colors, 1.0), atol=1e-6)
    np.testing.assert_allclose(made.opacities, 0.1, atol=1e-6)
    assert np.ptp(made.log_scales, axis=1).max() == 0.0
    assert made.sh_degree == degree


def test_points_that_coincide_get_a_finite_size():
    points = np.concatenate([np.zeros((600, 3)), np.random.default_rng(0).standard_normal((600, 3))]).astype(np.float32)
    views = ring_of_views()
    made = InitialGaussians().make(
        views, points, np.zeros((1200, 3), np.uint8), SceneFrame.around(views, points), np.random.default_rng(0), 5000
    )
    assert np.isfinite(made.log_scales).all()


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=20)
def test_the_frame_and_back_is_the_identity(seed):
    rng = np.random.default_rng(seed)
    frame = SceneFrame(rng.uniform(-50, 50, 3), float(np.exp(rng.uniform(-3, 3))))
    shapes = ((7, 3), (7, 3), (7, 4), (7,), (7, 1, 3))
    original = Gaussians(*(rng.standard_normal(shape).astype(np.float32) for shape in shapes))
    back = frame.to_world(frame.from_world(original))
    np.testing.assert_allclose(back.means, original.means, atol=1e-4)
    np.testing.assert_allclose(back.log_scales, original.log_scales, atol=1e-5)


def test_a_pose_in_the_frame_sees_the_same_pixels():
    views = ring_of_views(radius=40.0, centre=(1000.0, 2000.0, -5.0))
    frame = SceneFrame.around(views, NO_POINTS[0])
    point = np.array([1003.0, 1998.0, -4.0])
    for view in views:
        world = view.world_to_camera @ [*point, 1.0]
        local = frame.world_to_camera(view.world_to_camera) @ [*frame.points(point[None])[0], 1.0]
        np.testing.assert_allclose(local[:2] / local[2], world[:2] / world[2], atol=1e-5)


def test_cameras_that_share_a_centre_take_their_scale_from_the_points():
    views = ring_of_views(count=4, radius=0.0001)
    for view in views:
        view.world_to_camera[:3, 3] = 0.0
    points = np.random.default_rng(0).standard_normal((100, 3)).astype(np.float32) * 7
    frame = SceneFrame.around(views, points)
    assert frame.scale == pytest.approx(1 / np.median(np.linalg.norm(points, axis=1)), rel=1e-5)


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
