"""What is up in captures whose truth is known: drawn ones, the demo, and rooms with a floor."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.upright import DOWN_IS_Y, find_up, rotation_to
from cvdgs.core.demo import SHOWROOM

Z = np.array([0.0, 0.0, 1.0])
NO_POINTS = np.zeros((0, 3))


def unit(*vector: float) -> NDArray[np.float64]:
    return np.array(vector) / np.linalg.norm(vector)


def degrees_between(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(np.degrees(np.arccos(np.clip(first @ second, -1.0, 1.0))))


def ring(arc: float, up: NDArray[np.float64], *, pitch: float = 30.0, roll: float = 0.0) -> list[NDArray[np.float64]]:
    """Sixty poses along `arc` degrees of a ring, looking down by `pitch`, each rolled by `roll` at random."""
    generator = np.random.default_rng(0)
    turn = rotation_to(Z, up)
    poses = []
    for azimuth in np.radians(np.linspace(0.0, arc, 60, endpoint=False)):
        tilt = np.radians(pitch)
        forward = np.array([np.cos(azimuth) * np.cos(tilt), np.sin(azimuth) * np.cos(tilt), -np.sin(tilt)])
        right = unit(*np.cross(forward, Z))
        down = np.cross(forward, right)
        angle = np.radians(generator.normal(0.0, roll))
        right, down = np.cos(angle) * right + np.sin(angle) * down, np.cos(angle) * down - np.sin(angle) * right
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, down, forward]) @ turn.T
        poses.append(pose)
    return poses


@pytest.mark.parametrize("arc", [60.0, 180.0, 360.0])
@pytest.mark.parametrize("up", [Z, unit(0.3, -0.8, 0.5), unit(-1.0, 0.2, 0.1)])
def test_cameras_held_level_tell_what_is_up_from_any_side_and_looking_down(arc: float, up: NDArray[np.float64]) -> None:
    assert degrees_between(find_up(ring(arc, up, roll=3.0), NO_POINTS).direction, up) < 2.5


def test_some_photographs_on_their_side_change_nothing() -> None:
    up = unit(0.3, -0.8, 0.5)
    poses = ring(360.0, up, roll=2.0)
    on_its_side = np.eye(4)
    on_its_side[:3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    poses[::5] = [on_its_side @ pose for pose in poses[::5]]
    assert degrees_between(find_up(poses, NO_POINTS).direction, up) < 2.5


def test_a_floor_is_truer_than_hands() -> None:
    up = unit(0.3, -0.8, 0.5)
    held = unit(*(up + np.array([0.0, 0.05, 0.06])))  # four degrees off
    generator = np.random.default_rng(0)
    floor = np.c_[generator.uniform(-2.0, 2.0, (900, 2)), generator.normal(0.0, 0.004, 900)]
    clutter = generator.uniform(-2.0, 2.0, (2000, 3))
    points = np.concatenate([floor - [0.0, 0.0, 1.0], clutter]) @ rotation_to(Z, up).T
    assert degrees_between(held, up) > 3.0
    found = find_up(ring(360.0, held), points)
    assert found.source == "floor"
    assert degrees_between(found.direction, up) < 0.5


def test_a_wall_or_a_cloud_without_planes_is_no_floor() -> None:
    generator = np.random.default_rng(0)
    wall = np.c_[generator.normal(0.0, 0.004, 2000), generator.uniform(-2.0, 2.0, (2000, 2))]
    for points in (wall, generator.normal(size=(3000, 3)), np.full((500, 3), np.nan)):
        assert find_up(ring(360.0, unit(0.1, 0.2, 1.0)), points).source == "cameras"


def test_an_axis_that_is_nearly_up_was_meant() -> None:
    found = find_up(ring(360.0, unit(0.01, 0.01, -1.0)), NO_POINTS)
    assert found.source == "axis"
    np.testing.assert_array_equal(found.direction, -Z)


@pytest.mark.parametrize("direction", [Z, -DOWN_IS_Y, DOWN_IS_Y, unit(1.0, 2.0, 3.0)])
def test_turning_one_direction_to_another(direction: NDArray[np.float64]) -> None:
    rotation = rotation_to(direction, DOWN_IS_Y)
    np.testing.assert_allclose(rotation @ direction, DOWN_IS_Y, atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def seen(capture: Capture) -> NDArray[np.float64]:
    pose = capture.views[3].world_to_camera
    return capture.points @ pose[:3, :3].T + pose[:3, 3]


def test_the_demo_stands_upright_as_it_is_and_turning_it_moves_all_of_it() -> None:
    capture = read_capture(SHOWROOM, max_size=64)
    assert capture.up is not None
    np.testing.assert_array_equal(capture.up.direction, Z)
    turned = capture.turned(rotation_to(Z, DOWN_IS_Y))
    assert turned.up is not None
    np.testing.assert_allclose(turned.up.direction, DOWN_IS_Y, atol=1e-12)
    np.testing.assert_allclose(seen(turned), seen(capture), atol=1e-4)
