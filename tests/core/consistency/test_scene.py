"""A scene's views are matched once, whoever asks, and neighbours are views that look alike."""

from __future__ import annotations

import numpy as np
import pytest

from cvdgs.core.consistency import CorrespondenceSettings, SceneCorrespondences, find_correspondences, nearest_views
from cvdgs.core.consistency.scene import MOST_TRIED_PIXELS

from . import scenes

WALL = scenes.Plane((0.0, 0.1, 1.0), 1.0)
VIEWS = [scenes.camera_at((x, -0.3, -4.0)) for x in (-0.6, -0.2, 0.2, 0.6)]


@pytest.fixture
def asked() -> list[int]:
    return []


@pytest.fixture
def correspondences(asked) -> SceneCorrespondences:
    _, depths, alphas, _ = scenes.render_all(VIEWS, [WALL])

    def depth(index: int) -> tuple[np.ndarray, np.ndarray]:
        asked.append(index)
        return depths[index].astype(np.float32), alphas[index].astype(np.float32)

    return SceneCorrespondences(VIEWS, depth)


def test_a_pair_is_matched_once_and_a_depth_map_made_once(correspondences, asked):
    first = correspondences.between(0, 1)
    correspondences.of_pairs([(1, 2), (2, 1)])
    (again,) = correspondences.of_pairs([(0, 1)])
    assert again is first
    assert asked == [0, 1, 2]


def test_what_is_kept_is_what_matching_gives(correspondences):
    _, depths, alphas, _ = scenes.render_all(VIEWS, [WALL])
    (expected,) = find_correspondences(depths, alphas, VIEWS, [(0, 2)])
    found = correspondences.between(0, 2)
    assert len(found) > 1000
    np.testing.assert_array_equal(found.first_pixels, expected.first_pixels)
    np.testing.assert_allclose(found.second_positions, expected.second_positions, atol=1e-3)


def test_of_large_views_only_so_many_pixels_are_tried():
    def nothing(index: int) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((1, 1), np.float32), np.zeros((1, 1), np.float32)

    small, large = (
        SceneCorrespondences([scenes.camera_at((0, 0, -4), *size)], nothing).settings.stride
        for size in ((200, 150), (1600, 1200))
    )
    assert small == 1
    assert 1600 * 1200 / large**2 <= MOST_TRIED_PIXELS < 1600 * 1200 / (large - 1) ** 2
    given = CorrespondenceSettings(stride=7)
    assert SceneCorrespondences(VIEWS, nothing, given).settings is given


def test_neighbours_are_near_and_look_the_same_way():
    eyes = [(0, 0, -4), (0.5, 0, -4), (3, 0, -3), (0, 0, 4), (0.1, 0, -4)]
    views = [scenes.camera_at(eye) for eye in eyes]
    neighbours = nearest_views(views, range(5), 2)
    assert neighbours[0] == [4, 1]
    assert 3 not in neighbours[1]


def test_neighbours_are_chosen_among_the_views_that_take_part():
    neighbours = nearest_views(VIEWS, [0, 2, 3], 4)
    assert neighbours == {0: [2, 3], 2: [3, 0], 3: [2, 0]}


def test_a_panorama_from_one_place_has_neighbours_by_direction():
    views = [scenes.Posed(VIEWS[0].camera, scenes.look_at((0, 0, 0), (np.sin(a), 0, np.cos(a)))) for a in (0, 0.2, 1)]
    assert nearest_views(views, range(3), 1) == {0: [1], 1: [0], 2: [1]}
