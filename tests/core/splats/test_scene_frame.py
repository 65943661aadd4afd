"""The frame is a similarity that poses follow, and the place that cameras look at is found from their axes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.splats.scene_frame import SceneFrame, nearest_to_axes, unit_of_length

SEEDS = st.integers(0, 2**32 - 1)


def directions(count: int, rng: np.random.Generator) -> np.ndarray:
    drawn = rng.normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


@given(seed=SEEDS, scale=st.floats(1e-3, 1e3))
def test_a_point_is_at_the_same_pixel_in_the_world_and_in_the_frame(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    frame = SceneFrame(rng.normal(size=3), scale)
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pose[:3, 3] = rng.normal(size=3)
    point = rng.normal(size=3)
    in_frame = frame.world_to_camera(pose)
    local = in_frame[:3, :3] @ ((point - frame.origin) * scale) + in_frame[:3, 3]
    assert local == pytest.approx(scale * (pose[:3, :3] @ point + pose[:3, 3]), rel=1e-9, abs=1e-9 * scale)
    assert frame.pose_to_world(in_frame) == pytest.approx(pose, abs=1e-9)


CAMERA = PinholeCamera(96, 72, 100.0, 100.0, 48.0, 36.0)


def facing(places: np.ndarray) -> list[np.ndarray]:
    """Poses at (V, 2) places across that look along +Z."""
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :2, 3] = -places
    return list(poses)


def test_around_an_object_the_unit_is_the_distance_of_the_farthest_camera() -> None:
    poses = facing(np.array([[-1.0, 0.0], [0.0, 0.0], [0.0, 0.5], [1.0, 0.0]]))
    points = np.random.default_rng(0).uniform([-0.5, -0.5, 1.5], [0.5, 0.5, 2.5], (300, 3)).astype(np.float32)
    assert unit_of_length(poses, [CAMERA] * 4, points) == pytest.approx(np.hypot(1.0, 0.125))
    assert unit_of_length(poses, [CAMERA] * 4, points[:0]) == pytest.approx(np.hypot(1.0, 0.125))


@pytest.mark.parametrize("length", [20.0, 2000.0])
def test_on_a_long_way_the_unit_is_three_depths_of_what_is_seen(length: float) -> None:
    """Or a near plane of a share of the unit would cut it off."""
    along = np.linspace(-length, length, 41)
    poses = facing(np.stack([along, np.zeros(41)], axis=1))
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform([x - 0.5, -0.5, 1.9], [x + 0.5, 0.5, 2.1], (50, 3)) for x in along])
    assert unit_of_length(poses, [CAMERA] * 41, points) == pytest.approx(6.0, rel=0.02)


@given(seed=SEEDS, count=st.integers(3, 40))
def test_axes_that_meet_are_nearest_to_where_they_do(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    focus, axes = rng.normal(size=3), directions(count, rng)
    centers = focus - axes * rng.uniform(0.5, 5.0, (count, 1))
    found = nearest_to_axes(centers, axes)
    assert found is None or found == pytest.approx(focus, abs=1e-6)


def test_of_axes_that_pass_each_other_the_middle_of_their_common_normal_is_nearest() -> None:
    centers, axes = np.array([[-3.0, 0.0, 1.0], [0.0, 5.0, -1.0]]), np.eye(3)[:2]
    found = nearest_to_axes(centers, axes)
    assert found == pytest.approx(np.zeros(3))


@pytest.mark.parametrize("aside", [0.0, 1e-3], ids=["parallel", "nearly parallel"])
def test_parallel_axes_have_no_place_that_is_nearest(aside: float) -> None:
    axes = np.array([[0.0, 0.0, 1.0], [np.sin(aside), 0.0, np.cos(aside)]])
    assert nearest_to_axes(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), axes) is None
