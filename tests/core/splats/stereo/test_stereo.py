"""Dense stereo: depth maps against an independent implementation, and points against walls that are known."""

import numpy as np
import pytest

from cvdgs.core.splats.stereo import StereoPlan, StereoView, agreeing, compute_depth_maps, thinned
from cvdgs.core.splats.stereo.depth_maps import choose_neighbours, depth_ranges

from . import reference
from .scenes import DISTANCE, camera_at, plain, texture, views_of_wall, wall_view

PLAN = StereoPlan()
NEAR, FAR = 2.0, 9.0


def reduced(views, side: float = 96) -> list[StereoView]:
    return [StereoView.of(view, view.world_to_camera, side) for view in views]


def maps_of(views, **options):
    return compute_depth_maps(views, np.tile([NEAR, FAR], (len(views), 1)), PLAN, **options)


@pytest.fixture(scope="module")
def wall():
    return maps_of(reduced(views_of_wall()))


@pytest.mark.parametrize("disc", [None, 0.9])
def test_the_kernel_agrees_with_the_reference(disc):
    views = reduced(views_of_wall(4, size=(48, 36), disc=disc))
    maps = maps_of(views)
    levels = 40  # of a photograph of 48 pixels
    for index in (0, 2):
        others = [views[i] for i in maps.neighbours[index] if i >= 0]
        expected = reference.inverse_depths(views[index], others, NEAR, FAR, levels, PLAN)
        step = (1 / NEAR - 1 / FAR) / (levels - 1)
        # Where two levels cost the same, rounding decides.
        assert np.quantile(np.abs(maps.inverse_depths[index] - expected), 0.97) < 0.02 * step
        np.testing.assert_array_equal(maps.inverse_depths[index] == 0.0, expected == 0.0)


def test_points_lie_on_a_textured_wall(wall):
    points = agreeing(wall, 0.05, 2)
    pixels = sum(depth.size for depth in wall.inverse_depths)
    assert len(points) > 0.7 * pixels
    off = np.abs(points.positions[:, 2]) / DISTANCE
    assert np.median(off) < 0.005
    assert np.quantile(off, 0.95) < 0.03


def test_points_have_the_colour_of_the_wall_and_the_size_of_a_pixel(wall):
    points = agreeing(wall, 0.05, 2)
    expected = texture(points.positions[:, 0], points.positions[:, 1])
    assert np.median(np.abs(points.colors - expected)) < 0.03
    np.testing.assert_allclose(points.footprints, DISTANCE / (96 * 0.9), rtol=0.4)


def test_a_plain_wall_gives_no_points():
    assert len(agreeing(maps_of(reduced(views_of_wall(colors=plain))), 0.05, 2)) == 0


def test_a_plain_part_of_a_wall_gets_its_depth_from_what_surrounds_it():
    def with_a_plain_patch(x, y):
        return np.where((np.hypot(x, y) < 0.5)[..., None], 0.6, texture(x, y))

    points = agreeing(maps_of(reduced(views_of_wall(colors=with_a_plain_patch))), 0.05, 2)
    inside = np.hypot(*points.positions[:, :2].T) < 0.4
    assert inside.sum() > 500
    assert np.quantile(np.abs(points.positions[inside, 2]), 0.9) < 0.05 * DISTANCE


def test_two_views_suffice():
    points = agreeing(maps_of(reduced(views_of_wall(2))), 0.05, 2)
    assert len(points) > 1000
    assert np.median(np.abs(points.positions[:, 2])) < 0.01 * DISTANCE


def test_views_that_do_not_overlap_give_no_points():
    views = reduced([wall_view(camera_at(x, 0.0, towards=x)) for x in (-40.0, 40.0)])
    maps = maps_of(views)
    assert (maps.neighbours == -1).all()
    assert len(agreeing(maps, 0.05, 2)) == 0


def test_a_single_view_gives_no_points():
    assert len(agreeing(maps_of(reduced(views_of_wall(1))), 0.05, 2)) == 0


def test_views_from_one_place_give_no_points():
    views = reduced([wall_view(camera_at(0.0, 0.0, towards=0.2 * i)) for i in range(4)])
    assert len(agreeing(maps_of(views), 0.05, 2)) == 0


def test_a_cut_out_gives_points_only_where_it_is_covered():
    points = agreeing(maps_of(reduced(views_of_wall(disc=0.9))), 0.05, 2)
    assert len(points) > 1000
    assert np.quantile(np.hypot(*points.positions[:, :2].T), 0.98) < 1.1 * 0.9
    assert np.median(np.abs(points.positions[:, 2])) < 0.01 * DISTANCE


def test_the_number_of_threads_changes_nothing(wall):
    again = maps_of(wall.views, threads=1)
    for first, second in zip(wall.inverse_depths, again.inverse_depths, strict=True):
        np.testing.assert_array_equal(first, second)


def test_photographs_of_different_sizes_are_compared():
    views = views_of_wall(6)
    mixed = reduced(views[:3], 96) + reduced(views[3:], 48)
    points = agreeing(maps_of(mixed), 0.05, 2)
    assert np.median(np.abs(points.positions[:, 2])) < 0.01 * DISTANCE


def test_neighbours_see_the_same_place_from_a_useful_angle():
    near, same, far = camera_at(0.6, 0.0), camera_at(0.0, 0.0), camera_at(3.9, 0.0)
    views = reduced([wall_view(pose) for pose in (camera_at(0.0, 0.0), same, near, far)])
    chosen = choose_neighbours(views, np.tile([3.5, 4.5], (4, 1)), PLAN)
    assert chosen[0, 0] == 2
    assert 1 not in chosen[0]  # the same place tells nothing


def test_depths_are_looked_for_where_known_points_are():
    views = reduced(views_of_wall())
    known = np.random.default_rng(0).uniform([-1, -1, -0.2], [1, 1, 0.2], (500, 3)).astype(np.float32)
    for near, far in depth_ranges(views, known, (1e-3, 1e3)):
        assert 0.5 * DISTANCE < near < DISTANCE < far < 2.0 * DISTANCE
    np.testing.assert_array_equal(depth_ranges(views, known[:3], (1.0, 7.0))[0], [1.0, 7.0])


@pytest.mark.parametrize("count", [3000, 800, 150])
def test_thinned_points_cover_the_wall_evenly(wall, count):
    from scipy.spatial import cKDTree

    points = agreeing(wall, 0.05, 2)
    kept = thinned(points, count)
    assert 0.5 * count < len(kept) <= count
    gap = cKDTree(kept.positions).query(points.positions)[0]
    area = np.ptp(points.positions[:, 0]) * np.ptp(points.positions[:, 1])
    assert np.quantile(gap, 0.95) < 2.5 * np.sqrt(area / len(kept))


def test_no_point_is_left_where_one_is_known_already(wall):
    from scipy.spatial import cKDTree

    points = agreeing(wall, 0.05, 2)
    known = points.positions[np.abs(points.positions[:, 0]) < 0.5][::3]
    kept = thinned(points, 800, known).positions
    beside = np.abs(kept[:, 0]) < 0.4
    assert beside.mean() < 0.05
    assert cKDTree(known).query(kept)[0].min() > 0.0


def test_one_point_a_pixel_is_enough(wall):
    points = agreeing(wall, 0.05, 2)
    assert len(thinned(points, 10 * len(points))) < 0.8 * len(points)
    assert len(thinned(points, 0)) == 0
