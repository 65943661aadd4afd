"""Correspondences are exact on analytic scenes, never join different surfaces, and are found once per pair."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from cvdgs.core.consistency import (
    Correspondences,
    CorrespondenceSettings,
    SceneCorrespondences,
    nearest_views,
    view_pairs,
)
from cvdgs.core.consistency.correspondence import MOST_TRIED_PIXELS, _Packed, sample_bilinear

from ...effort import function_calls
from . import scenes

SLANTED = scenes.Plane((0.3, 0.2, 1.0), 0.0)
BACK = scenes.Plane((0.0, 0.1, 1.0), 1.5)
FRONT = scenes.Plane((0.0, 0.0, 1.0), -0.5, half_width=0.35, tint=0.2)
VIEWS = [scenes.camera_at((x, -0.3, -4.0 + 0.2 * x)) for x in (-1.0, -0.6, 0.9)]
ROW = [scenes.camera_at((x, -0.3, -4.0)) for x in (-0.6, -0.2, 0.2, 0.6)]


def test_a_slanted_plane_corresponds_exactly_wherever_both_views_see_it() -> None:
    _, depths, alphas, _ = scenes.render_all(VIEWS, [SLANTED])
    for found in scenes.match(depths, alphas, VIEWS, [(0, 1), (0, 2), (2, 0)]):
        points = scenes.world_points(VIEWS[found.first], depths[found.first]).reshape(-1, 3)
        expected = scenes.project(VIEWS[found.second], points)
        np.testing.assert_allclose(found.second_positions, expected[found.first_pixels], atol=2e-3)
        camera = VIEWS[found.second].camera
        visible = ((expected >= 0.5) & (expected <= [camera.width - 0.5, camera.height - 0.5])).all(1)
        assert set(found.first_pixels) == set(np.flatnonzero(visible))
        assert len(found) > 1000


def test_hidden_points_and_depth_edges_are_left_out() -> None:
    _, depths, alphas, seen = scenes.render_all(VIEWS, [BACK, FRONT])
    for found in scenes.match(depths, alphas, VIEWS, [(0, 2), (2, 0)]):
        first, second = VIEWS[found.first], VIEWS[found.second]
        points = scenes.world_points(first, depths[found.first]).reshape(-1, 3)[found.first_pixels]
        # Independent of any depth map: what stands between the point and the second camera?
        center = -second.world_to_camera[:3, :3].T @ second.world_to_camera[:3, 3]
        fraction = (FRONT.offset - center[2]) / (points[:, 2] - center[2])
        crossing = center + fraction[:, None] * (points - center)
        hidden = (fraction < 0.999) & (np.abs(crossing[:, 0]) < FRONT.half_width)
        assert not hidden.any()
        assert {0, 1} == set(seen[found.first].reshape(-1)[found.first_pixels])
        # Some of the background is hidden in the other view, so this could have failed.
        background = scenes.world_points(first, depths[found.first])[seen[found.first] == 0]
        through = center + ((FRONT.offset - center[2]) / (background[:, 2] - center[2]))[:, None] * (
            background - center
        )
        assert (np.abs(through[:, 0]) < FRONT.half_width).sum() > 100


def test_correspondences_keep_their_distance_from_depth_edges_in_both_views() -> None:
    _, depths, alphas, seen = scenes.render_all(VIEWS, [BACK, FRONT])
    (found,) = scenes.match(depths, alphas, VIEWS, [(0, 1)])
    edge_columns = np.flatnonzero(np.diff(seen[0][30]) != 0)  # the pixel left of each edge in row 30
    assert len(edge_columns) == 2
    in_row = found.first_pixels[found.first_pixels // 96 == 30] % 96
    for edge in edge_columns:
        assert not set(range(edge - 1, edge + 3)) & set(in_row)
    assert np.abs(in_row[:, None] - edge_columns[None]).min() <= 4  # and no further than it takes


def test_uncovered_pixels_have_no_correspondence() -> None:
    _, depths, alphas, _ = scenes.render_all(VIEWS, [SLANTED])
    alphas[0][:, :40] = 0.89
    alphas[1][:, 50:] = 0.5
    (found,) = scenes.match(depths, alphas, VIEWS, [(0, 1)])
    assert len(found) > 200
    assert (found.first_pixels % 96).min() >= 40
    assert found.second_positions[:, 0].max() <= 49.5


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, -1.0])
def test_meaningless_depths_are_left_out(value: float) -> None:
    _, depths, alphas, _ = scenes.render_all(VIEWS, [SLANTED])
    depths[0][:, :40] = value
    depths[1][:, 60:] = value
    (found,) = scenes.match(depths, alphas, VIEWS, [(0, 1)])
    assert len(found) > 200
    assert (found.first_pixels % 96).min() >= 40
    assert found.second_positions[:, 0].max() <= 60


def test_a_wrong_depth_in_either_view_breaks_the_correspondence() -> None:
    _, depths, alphas, _ = scenes.render_all(VIEWS, [SLANTED])
    (exact,) = scenes.match(depths, alphas, VIEWS, [(0, 1)])
    (wrong,) = scenes.match([depths[0], depths[1] * 1.1, depths[2]], alphas, VIEWS, [(0, 1)])
    assert len(exact) > 1000
    assert len(wrong) == 0


def test_a_point_that_returns_more_than_a_pixel_away_is_left_out_even_at_nearly_the_same_depth() -> None:
    views = [scenes.camera_at((x, 0.0, -4.0), width=240, height=180) for x in (-1.5, 1.5)]
    views = [replace(view, camera=replace(view.camera, fx=300.0, fy=300.0)) for view in views]
    _, depths, alphas, _ = scenes.render_all(views, [SLANTED])
    slightly_wrong = [depths[0], depths[1] * 1.007]  # 0.7 %, about 1.5 pixels of parallax
    lenient = CorrespondenceSettings(max_reprojection_error=3.0)
    (close,) = scenes.match(slightly_wrong, alphas, views, [(0, 1)], lenient)
    (closer,) = scenes.match(slightly_wrong, alphas, views, [(0, 1)])
    assert len(close) > 5000
    assert len(closer) == 0


def test_looking_away_gives_no_correspondence() -> None:
    away = replace(VIEWS[1], world_to_camera=np.diag([-1.0, 1.0, -1.0, 1.0]) @ VIEWS[1].world_to_camera)
    _, depths, alphas, _ = scenes.render_all(VIEWS, [SLANTED])
    (found,) = scenes.match([depths[0], depths[1]], [alphas[0], alphas[1]], [VIEWS[0], away], [(0, 1)])
    assert len(found) == 0


def test_views_may_differ_in_size() -> None:
    views = [VIEWS[0], scenes.camera_at((-0.5, -0.3, -4.0), width=130, height=60)]
    _, depths, alphas, _ = scenes.render_all(views, [SLANTED])
    (found,) = scenes.match(depths, alphas, views, [(0, 1)])
    expected = scenes.project(views[1], scenes.world_points(views[0], depths[0]).reshape(-1, 3)[found.first_pixels])
    assert len(found) > 500
    np.testing.assert_allclose(found.second_positions, expected, atol=2e-3)


def test_a_stride_thins_out_the_same_correspondences() -> None:
    _, depths, alphas, _ = scenes.render_all(VIEWS, [SLANTED])
    (all_of_them,) = scenes.match(depths, alphas, VIEWS, [(0, 1)])
    (thinned,) = scenes.match(depths, alphas, VIEWS, [(0, 1)], CorrespondenceSettings(stride=3))
    on_grid = (all_of_them.first_pixels % 96 % 3 == 0) & (all_of_them.first_pixels // 96 % 3 == 0)
    np.testing.assert_array_equal(thinned.first_pixels, all_of_them.first_pixels[on_grid])


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 500))
@settings(deadline=None)
def test_bilinear_sampling_agrees_with_scipy(height: int, width: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    image = generator.random((height, width))
    positions = generator.random((40, 2)) * [width, height]
    expected = map_coordinates(image, (positions - 0.5).T[::-1], order=1, mode="nearest")
    np.testing.assert_allclose(sample_bilinear(image, positions), expected, atol=1e-5)


def test_pairs_are_a_step_apart_in_file_order() -> None:
    assert view_pairs(4, 1) == [(0, 1), (1, 2), (2, 3)]
    assert view_pairs(9, 7) == [(0, 7), (1, 8)]
    assert view_pairs(5, 7) == []


def test_more_pixels_take_no_more_calls() -> None:
    def match(scale: int) -> int:
        views = [scenes.camera_at((x, -0.3, -4.0), width=60 * scale, height=45 * scale) for x in (-0.2, 0.2)]
        views = [replace(v, camera=replace(v.camera, fx=50.0 * scale, fy=50.0 * scale)) for v in views]
        _, depths, alphas, _ = scenes.render_all(views, [SLANTED])
        return function_calls(lambda: scenes.match(depths, alphas, views, [(0, 1)]))

    assert match(8) < 2 * match(1)


@pytest.fixture
def asked() -> list[int]:
    return []


@pytest.fixture
def correspondences(asked) -> SceneCorrespondences:
    _, depths, alphas, _ = scenes.render_all(ROW, [BACK])

    def depth(index: int) -> tuple[np.ndarray, np.ndarray]:
        asked.append(index)
        return depths[index].astype(np.float32), alphas[index].astype(np.float32)

    return SceneCorrespondences(ROW, depth)


def test_a_pair_is_matched_once_and_a_depth_map_made_once(correspondences, asked):
    first = correspondences.between(0, 1)
    correspondences.of_pairs([(1, 2), (2, 1)])
    (again,) = correspondences.of_pairs([(0, 1)])
    np.testing.assert_array_equal(again.first_pixels, first.first_pixels)
    np.testing.assert_array_equal(again.second_positions, first.second_positions)
    assert asked == [0, 1, 2]


@settings(deadline=None, max_examples=40)
@given(
    st.tuples(st.integers(1, 70), st.integers(1, 70)),
    st.tuples(st.integers(1, 2000), st.integers(1, 2000)),
    st.integers(1, 9),
    st.integers(0, 2**32 - 1),
)
def test_correspondences_keep_their_pixels_and_positions_when_they_are_packed(size, other_size, stride, seed):
    rng = np.random.default_rng(seed)
    camera, other = (scenes.camera_at((0, 0, -4), *sides).camera for sides in (size, other_size))
    tried = np.zeros((camera.height, camera.width), bool)
    tried[::stride, ::stride] = True
    pixels = np.flatnonzero(tried & (rng.random(tried.shape) < 0.5)).astype(np.int32)
    positions = (rng.random((len(pixels), 2)) * [other.width, other.height]).astype(np.float32)
    packed = _Packed.of(Correspondences(3, 1, pixels, positions), camera, other, stride)
    found = packed.unpacked()
    assert (found.first, found.second) == (3, 1)
    np.testing.assert_array_equal(found.first_pixels, pixels)
    assert found.first_pixels.dtype == np.int32
    assert found.second_positions.dtype == np.float32
    np.testing.assert_allclose(found.second_positions, positions, atol=2000 / 65535)
    assert packed.matched.nbytes + packed.positions.nbytes <= 4 * len(pixels) + tried[::stride, ::stride].size / 8 + 1


def test_a_depth_map_in_single_precision_is_enough(correspondences):
    _, depths, alphas, _ = scenes.render_all(ROW, [BACK])
    (expected,) = scenes.match(depths, alphas, ROW, [(0, 2)])
    found = correspondences.between(0, 2)
    assert len(found) > 1000
    np.testing.assert_array_equal(found.first_pixels, expected.first_pixels)
    np.testing.assert_allclose(found.second_positions, expected.second_positions, atol=2e-3)


def test_the_number_of_pixels_tried_in_large_views_is_limited():
    def nothing(index: int) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((1, 1), np.float32), np.zeros((1, 1), np.float32)

    small, large = (
        SceneCorrespondences([scenes.camera_at((0, 0, -4), *size)], nothing).settings.stride
        for size in ((200, 150), (1600, 1200))
    )
    assert small == 1
    assert 1600 * 1200 / large**2 <= MOST_TRIED_PIXELS < 1600 * 1200 / (large - 1) ** 2
    given = CorrespondenceSettings(stride=7)
    assert SceneCorrespondences(ROW, nothing, given).settings is given


def test_neighbours_are_near_and_look_the_same_way():
    eyes = [(0, 0, -4), (0.5, 0, -4), (3, 0, -3), (0, 0, 4), (0.1, 0, -4)]
    views = [scenes.camera_at(eye) for eye in eyes]
    neighbours = nearest_views(views, range(5), 2)
    assert neighbours[0] == [4, 1]
    assert 3 not in neighbours[1]


def test_neighbours_are_chosen_among_the_views_that_take_part():
    neighbours = nearest_views(ROW, [0, 2, 3], 4)
    assert neighbours == {0: [2, 3], 2: [3, 0], 3: [2, 0]}


def test_a_panorama_from_one_place_has_neighbours_by_direction():
    views = [scenes.Posed(ROW[0].camera, scenes.look_at((0, 0, 0), (np.sin(a), 0, np.cos(a)))) for a in (0, 0.2, 1)]
    assert nearest_views(views, range(3), 1) == {0: [1], 1: [0], 2: [1]}
