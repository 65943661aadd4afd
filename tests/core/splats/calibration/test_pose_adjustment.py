"""Poses that are far off come back by what the views have in common, and what nothing holds stays."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.view_matches import ViewMatches, neighbours, poses_of
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.splats.calibration.pose_adjustment import AdjustedPoses, adjust_poses

from ...capture.test_view_matches import turned


@pytest.fixture(scope="module")
def showroom() -> Capture:
    return read_capture(SHOWROOM, max_size=200)


def adjusted(capture: Capture) -> AdjustedPoses | None:
    pairs = sorted({pair for near in neighbours(poses_of(capture.views)) for pair in near})
    return adjust_poses(ViewMatches(capture.views, seed=0), pairs)


@pytest.fixture(scope="module")
def found(showroom) -> AdjustedPoses:
    result = adjusted(turned(showroom, 3.0))
    assert result is not None
    return result


def degrees_off(found: AdjustedPoses, truth: Capture) -> list[float]:
    return [
        float(np.degrees(Rotation.from_matrix(pose[:3, :3] @ truth.views[view].world_to_camera[:3, :3].T).magnitude()))
        for view, pose in found.poses.items()
    ]


def test_cameras_that_were_turned_come_back(found, showroom):
    off = degrees_off(found, showroom)
    assert len(off) == len(showroom.views)
    assert np.median(off) < 0.5
    assert max(off) < 1.5


def test_they_stay_in_the_world_of_the_given_ones(found, showroom):
    centers = np.array([view.center for view in showroom.views])
    moved = [np.linalg.norm(-pose[:3, :3].T @ pose[:3, 3] - centers[view]) for view, pose in found.poses.items()]
    assert np.mean(moved) < 0.02 * np.sqrt(centers.var(axis=0).sum())


def test_points_lie_where_the_scene_is_and_have_its_colours(found, showroom):
    """Each is closest to one of the capture's own points, which are dense on this scene's surfaces."""
    assert len(found.points) == len(found.points_before) == len(found.colors) > 500
    size = np.ptp(showroom.points, axis=0).max()
    apart = np.linalg.norm(found.points[:, None] - showroom.points[None, ::3], axis=2).min(axis=1)
    before = np.linalg.norm(found.points_before[:, None] - showroom.points[None, ::3], axis=2).min(axis=1)
    assert np.median(apart) < 0.02 * size
    assert np.median(apart) < 0.5 * np.median(before)
    nearest = np.linalg.norm(found.points[:, None] - showroom.points[None, ::3], axis=2).argmin(axis=1)
    difference = np.abs(found.colors.astype(float) - showroom.point_colors[::3][nearest]).mean(axis=1)
    unrelated = np.abs(found.colors.astype(float) - showroom.point_colors[::3][nearest[::-1]]).mean(axis=1)
    assert np.median(difference) < 0.7 * np.median(unrelated)


def test_the_same_views_give_the_same_bits(found, showroom):
    again = adjusted(turned(showroom, 3.0))
    assert again is not None
    assert found.poses.keys() == again.poses.keys()
    assert all(np.array_equal(pose, again.poses[view]) for view, pose in found.poses.items())
    assert np.array_equal(found.points, again.points)


def test_views_that_have_nothing_in_common_hold_none(showroom):
    noise = np.random.default_rng(0)
    views = tuple(
        replace(view, image=noise.integers(0, 256, view.image.shape).astype(np.uint8)) for view in showroom.views[:12]
    )
    assert adjusted(replace(showroom, views=views)) is None


def test_a_view_that_nothing_holds_keeps_its_pose(showroom):
    blank = replace(showroom.views[5], image=np.full_like(showroom.views[5].image, 128))
    views = (*showroom.views[:5], blank, *showroom.views[6:])
    found = adjusted(turned(replace(showroom, views=views), 2.0))
    assert found is not None
    assert set(range(len(views))) - set(found.poses) == {5}


@pytest.mark.parametrize("along", [0.0, 1.0], ids=["on-the-spot", "on-a-line"])
def test_cameras_that_span_no_plane_stay(showroom, along: float):
    """A world is not fixed by them."""
    poses = {}
    for index, view in enumerate(showroom.views):
        pose = view.world_to_camera.copy()
        pose[:3, 3] = -pose[:3, :3] @ (along * index, 0.0, 0.0)
        poses[view.key] = pose
    assert adjusted(showroom.moved(poses)) is None
