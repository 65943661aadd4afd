"""Which direction of a capture's world is up: from how cameras were held, refined by floors and tables. numpy only.

Photographers hold a camera level, so that the x axes of upright photographs are horizontal: up is what is most nearly
at right angles to all of them. A hand is off by some degrees and a floor is not, so the normal of the largest plane
near that direction is taken where the points show one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Directions of x axes must differ by this much, as a share of the largest variance, to say by themselves what is up.
_LEAST_TURN = 0.02
_CONE = np.radians(12.0)  # around what the cameras say: how far off hands are
_SNAP = np.radians(2.0)  # from an axis of the world, within which that axis was meant
_TRIALS = 3000
_MOST_POINTS = 20_000
_LEAST_POINTS = 200  # below that no plane is looked for
_THICKNESS = 0.006  # of a plane, as a share of the extent of the points
_LEAST_SHARE = 0.06  # of the points, on a plane
_LEAST_WIDTH = 0.08  # of the extent: standard deviation of a plane's points along its narrower side
# Length of the mean of the cameras' up directions from which it says something, and how far it can be off: photographs
# taken obliquely from above have a mean far from up where they are on one side.
_AGREED, _DISAGREEMENT = 0.3, np.radians(50.0)
_ROUNDS = 4  # of fitting a plane to the points near it
_TRIM = 2.0  # percent of the points at each end of an axis that are strays


@dataclass(frozen=True)
class UpDirection:
    """What is up, and how that is known.

    Attributes:
        direction: (3,) unit vector.
        source: "cameras", "floor" (a plane that the points show) or "axis" (an axis of the capture's world).
    """

    direction: NDArray[np.float64]
    source: str


DOWN_IS_Y = np.array([0.0, -1.0, 0.0])
"""Up in the world of estimated cameras: y points down as in cameras, which viewers of splat files take for upright."""


def find_up(poses: Sequence[NDArray[np.float64]], points: NDArray[np.floating]) -> UpDirection:
    """The direction of a capture's world that is up.

    Args:
        poses: (4, 4) world-to-camera of upright photographs, OpenCV axes.
        points: (P, 3) sparse points; P may be 0.
    """
    held = _from_cameras(np.stack(poses)[:, :3, :3])
    plane = _floor(np.asarray(points, np.float64), held)
    found = UpDirection(held, "cameras") if plane is None else UpDirection(plane, "floor")
    axis = np.zeros(3)
    largest = int(np.argmax(np.abs(found.direction)))
    axis[largest] = np.sign(found.direction[largest])
    return UpDirection(axis, "axis") if _angle(axis, found.direction) <= _SNAP else found


def _from_cameras(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """From (N, 3, 3) world-to-camera rotations; photographs that were held otherwise than most count less."""
    right, upwards = rotations[:, 0], -rotations[:, 1]
    mean = upwards.mean(axis=0)
    norm = float(np.linalg.norm(mean))
    up = mean / norm if norm > 1e-6 else np.array([0.0, 0.0, 1.0])
    weights = np.ones(len(right))
    for _ in range(10):
        values, vectors = np.linalg.eigh((right * weights[:, None]).T @ right)
        if values[1] < _LEAST_TURN * values[2]:
            break  # all look the same way: then pitch is known from the mean alone
        candidate = vectors[:, 0] * np.sign(vectors[:, 0] @ up or 1.0)
        if norm > _AGREED and _angle(candidate, up) > _DISAGREEMENT:
            break  # most were held on their side; the mean is nearer then
        tilt = right @ candidate
        weights = 1.0 / (1.0 + (tilt / np.sin(np.radians(3.0))) ** 2)
        up = candidate
    return up


def _floor(points: NDArray[np.float64], held: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The normal, near `held`, of the plane that most points lie on; None where they show none."""
    generator = np.random.default_rng(0)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < _LEAST_POINTS:
        return None
    low, high = np.percentile(points, [_TRIM, 100.0 - _TRIM], axis=0)
    points = points[((points >= low) & (points <= high)).all(axis=1)]
    points = points[generator.permutation(len(points))[:_MOST_POINTS]]
    if len(points) < _LEAST_POINTS:
        return None
    extent = float(np.linalg.norm(high - low))
    best, most = None, _LEAST_SHARE * len(points)
    for _ in range(_TRIALS):
        three = points[generator.integers(0, len(points), 3)]
        normal = np.cross(three[1] - three[0], three[2] - three[0])
        length = float(np.linalg.norm(normal))
        if length < 1e-12 * extent**2:
            continue
        normal *= np.sign(normal @ held or 1.0) / length
        if _angle(normal, held) > _CONE:
            continue
        near = np.abs(points @ normal - normal @ three[0]) < _THICKNESS * extent
        if np.count_nonzero(near) > most:
            best, most = near, float(np.count_nonzero(near))
    normal = held
    for _ in range(_ROUNDS):
        if best is None:
            return None
        center = points[best].mean(axis=0)
        _, spread, axes = np.linalg.svd(points[best] - center, full_matrices=False)
        normal = axes[2] * np.sign(axes[2] @ held or 1.0)
        if spread[1] / np.sqrt(most) < _LEAST_WIDTH * extent or _angle(normal, held) > _CONE:
            return None
        best = np.abs((points - center) @ normal) < _THICKNESS * extent
        most = float(np.count_nonzero(best))
    return normal


def _angle(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(np.arccos(np.clip(first @ second, -1.0, 1.0)))


def rotation_to(direction: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest (3, 3) rotation that takes the unit vector `direction` to the unit vector `axis`."""
    cosine = float(direction @ axis)
    if cosine < -1.0 + 1e-9:
        other = np.eye(3)[int(np.argmin(np.abs(direction)))]
        across = np.cross(direction, other)
        across /= np.linalg.norm(across)
        return 2.0 * np.outer(across, across) - np.eye(3)
    x, y, z = np.cross(direction, axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + cosine)
