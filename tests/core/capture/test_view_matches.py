"""What views show in common, by features of their pictures: it fits right cameras, and no others."""

from dataclasses import replace

import numpy as np
import pycolmap
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cvdgs.core.capture.epipolar import sampson_distances
from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.view_matches import ViewMatches, agreement, neighbours, poses_of
from cvdgs.core.demo import SHOWROOM

FOCAL = 500.0


@pytest.fixture(scope="module")
def showroom() -> Capture:
    return read_capture(SHOWROOM, max_size=160)


@pytest.fixture(scope="module")
def matches(showroom) -> ViewMatches:
    return ViewMatches(showroom.views, seed=0)


def turned(capture: Capture, degrees: float, seed: int = 0) -> Capture:
    """Each camera turned about an axis of its own through its centre."""
    rng = np.random.default_rng(seed)
    poses = {}
    for view in capture.views:
        axis, turn = rng.normal(size=3), np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
        poses[view.key] = turn @ view.world_to_camera
    return capture.moved(poses)


@given(st.integers(0, 1000), st.floats(0.1, 3.0))
def test_a_match_is_off_as_it_was_moved_across_its_epipolar_line_and_not_along_it(seed: int, pixels: float):
    rng = np.random.default_rng(seed)
    move = pycolmap.Rigid3d(pycolmap.Rotation3d(rng.normal(size=3) * 0.1), rng.normal(size=3) + np.eye(3)[0])
    points = rng.uniform((-1.0, -1.0, 4.0), (1.0, 1.0, 6.0), (8, 3))
    others = points @ move.rotation.matrix().T + move.translation
    first, second = (found[:, :2] / found[:, 2:] for found in (points, others))
    lines = np.column_stack([first, np.ones(8)]) @ pycolmap.essential_matrix_from_pose(move).T
    across = lines[:, :2] / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    along = across[:, ::-1] * (1.0, -1.0)
    assert sampson_distances(first, second, move).max() < 1e-9
    assert sampson_distances(first, second + along * pixels / FOCAL, move).max() < 1e-9
    off = sampson_distances(first, second + across * pixels / FOCAL, move) * FOCAL
    # The other photograph may be as much to blame, and more where its line moves faster.
    assert (off < pixels).all()
    assert (off > 0.05 * pixels).all()


def test_what_right_cameras_see_fits_them(matches):
    assert agreement(matches, poses_of(matches.views)) > 0.95


def test_what_turned_cameras_see_does_not_fit_them(showroom, matches):
    assert agreement(matches, poses_of(turned(showroom, 2.0).views)) < 0.6


def test_pictures_without_features_tell_nothing(showroom):
    grey = tuple(replace(view, image=np.full_like(view.image, 128)) for view in showroom.views)
    assert np.isnan(agreement(ViewMatches(grey, seed=0), poses_of(grey)))


def test_features_lie_where_a_mask_lets_one_look(showroom):
    view = showroom.views[0]
    region = np.zeros(view.image.shape[:2], bool)
    region[:, : view.camera.width // 2] = True
    positions = ViewMatches([view.without(region)], seed=0).positions(0)
    assert len(positions) > 10
    assert (positions[:, 0] >= view.camera.width // 2).all()
    assert len(positions) < len(ViewMatches([view], seed=0).positions(0))


def test_features_of_a_large_view_are_sought_in_a_smaller_picture(showroom):
    """The same lens and field of view in five times as many pixels a side; places are those of the smaller picture."""
    view = showroom.views[0]
    large = replace(
        view,
        image=view.image.repeat(5, axis=0).repeat(5, axis=1),
        camera=view.camera.scaled(800, view.camera.height * 5),
    )
    matches = ViewMatches([large], seed=0)
    assert matches.cameras[0].width == 640
    positions = matches.positions(0)
    assert positions.max(initial=0.0) < 640
    column, row = (positions[10] * 800 / 640).astype(int)
    np.testing.assert_array_equal(matches.color(0, 10), large.image[row, column])


def test_matches_are_the_same_every_time(showroom, matches):
    pair = neighbours(poses_of(showroom.views))[3][0]
    np.testing.assert_array_equal(matches.common(pair), ViewMatches(showroom.views, seed=0).common(pair))
    assert matches.share_that_fits(pair, poses_of(showroom.views)) > 0.9


def test_neighbours_stand_near_and_are_named_once(showroom):
    found = neighbours(poses_of(showroom.views))
    assert len(found) == len(showroom.views)
    for view, pairs in enumerate(found):
        assert len(set(pairs)) == len(pairs)
        assert all(view in pair and pair[0] < pair[1] for pair in pairs)
        apart = [np.linalg.norm(np.subtract(*(showroom.views[one].center for one in pair))) for pair in pairs]
        assert apart[0] < apart[-1]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_few_views_are_each_others_neighbours(showroom, count: int):
    found = neighbours(poses_of(showroom.views[:count]))
    assert [len(pairs) for pairs in found] == [count - 1] * count


def test_a_single_view_tells_nothing(showroom):
    single = showroom.views[:1]
    assert np.isnan(agreement(ViewMatches(single, seed=0), poses_of(single)))
