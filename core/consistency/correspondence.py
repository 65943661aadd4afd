"""Which pixels of two views show the same surface point: correspondences from depth, coverage and cameras.

A pixel is unprojected by its depth and projected into the other view; that view's depth is sampled there, and the point
it gives is projected back. The pair is accepted if it returns to within a pixel and to the same depth, lies on covered
surface in both views, and is not at a depth edge, where rendered depth is a mixture of two surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from ..capture.model import PinholeCamera
from ..runtime.protocol import Reporter

SHORT_RANGE_STEP = 1
"""Between adjacent views, in file order."""
LONG_RANGE_STEP = 7
"""Between views, in file order, that test long-range consistency."""
MOST_TRIED_PIXELS = 40_000
"""Per view: drift and gloss are smooth and more samples change no mean, but time and memory grow with their number."""

_SURFACES_KEPT = 64  # pairs are mostly asked for in the order of their first view, beside which the second ones are

_FINEST = np.float32(65535.0)  # steps of a position, of a hundredth of a pixel at 640 pixels: matching is less exact

Floats = NDArray[np.float64]
DepthOfView = Callable[[int], tuple[NDArray, NDArray]]
"""Index of a view to its (H, W) planar depth, divided by alpha and arbitrary where nothing is seen, and its alpha."""


class PosedCamera(Protocol):
    """The part of a `View` that is needed here."""

    @property
    def camera(self) -> PinholeCamera:
        """Intrinsics, in pixels of the depth map."""

    @property
    def world_to_camera(self) -> Floats:
        """(4, 4) rigid."""


@dataclass(frozen=True)
class CorrespondenceSettings:
    """When a correspondence is accepted.

    Attributes:
        max_reprojection_error: pixels between a pixel and where it returns to.
        max_relative_depth_error: |returned depth - depth| / depth.
        min_alpha: coverage in both views.
        max_disparity_bend: second difference of the inverse depth over one pixel, relative to the inverse depth; more
            is a depth edge. The inverse depth of a plane is linear in the image, however slanted the plane is.
        edge_margin: pixels around a depth edge that are rejected as well.
        stride: between the rows and columns of the first view that are tried; 1 tries every pixel.
    """

    max_reprojection_error: float = 1.0
    max_relative_depth_error: float = 0.01
    min_alpha: float = 0.9
    max_disparity_bend: float = 0.02
    edge_margin: int = 1
    stride: int = 1


@dataclass(frozen=True)
class Correspondences:
    """M surface points that two views both see.

    Attributes:
        first, second: indices of the views.
        first_pixels: (M,) int32, flat indices (row * width + column) of pixels in the first view.
        second_positions: (M, 2) float32, x and y in the second view; pixel centres lie at +0.5.
    """

    first: int
    second: int
    first_pixels: NDArray[np.int32]
    second_positions: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.first_pixels)


class SceneCorrespondences:
    """The correspondences between `views`, each pair matched on first request and kept.

    Args:
        views: the cameras.
        depth: called when a view is needed; the surfaces of all would fill the memory, so only the last few are kept.
        settings: when a correspondence is accepted; None takes the defaults with a stride that tries at most
            `MOST_TRIED_PIXELS` of a view.
    """

    def __init__(
        self, views: Sequence[PosedCamera], depth: DepthOfView, settings: CorrespondenceSettings | None = None
    ) -> None:
        self.views = views
        self.settings = settings or CorrespondenceSettings(stride=_stride(views))
        self._surface = lru_cache(_SURFACES_KEPT)(lambda index: _trusted_surface(*depth(index), self.settings))
        self._found: dict[tuple[int, int], _Packed] = {}

    def between(self, first: int, second: int) -> Correspondences:
        """The points that two views both see, from the pixels of the first."""
        return self._packed(first, second).unpacked()

    def match(
        self, pairs: Sequence[tuple[int, int]], reporter: Reporter | None = None, stage: str = "correspondences"
    ) -> None:
        """Find what `between` gives for each pair; reports progress of `stage`."""
        reporter = reporter or Reporter()
        for number, (first, second) in enumerate(pairs):
            self._packed(first, second)
            reporter.progress(stage, (number + 1) / len(pairs), "matching points between views")
        if len(self.views) > _SURFACES_KEPT:  # those that are left are the last ones; who comes next asks for the first
            self._surface.cache_clear()

    def of_pairs(self, pairs: Sequence[tuple[int, int]]) -> list[Correspondences]:
        """`between` for each pair."""
        self.match(pairs)
        return [self.between(first, second) for first, second in pairs]

    def _packed(self, first: int, second: int) -> _Packed:
        if (first, second) not in self._found:
            camera, other = self.views[first].camera, self.views[second].camera
            found = self._match(first, second)
            self._found[first, second] = _Packed.of(found, camera, other, self.settings.stride)
        return self._found[first, second]

    def _match(self, first: int, second: int) -> Correspondences:
        settings = self.settings
        surface, other_surface = self._surface(first), self._surface(second)
        pose, other_pose = self.views[first].world_to_camera, self.views[second].world_to_camera
        camera, other = self.views[first].camera, self.views[second].camera
        tried = np.zeros(surface.shape, bool)
        tried[:: settings.stride, :: settings.stride] = True
        pixels = np.flatnonzero(tried & np.isfinite(surface))
        centers = np.stack([pixels % camera.width, pixels // camera.width], -1) + 0.5
        depth = 1.0 / surface.reshape(-1)[pixels].astype(np.float64)

        forward = other_pose @ np.linalg.inv(pose)
        positions, expected = _project(other, _transformed(forward, _unproject(camera, centers, depth)))
        inside = (
            (expected > 0.0) & (positions >= 0.5).all(1) & (positions <= [other.width - 0.5, other.height - 0.5]).all(1)
        )
        pixels, centers, depth, positions = pixels[inside], centers[inside], depth[inside], positions[inside]

        met = 1.0 / sample_bilinear(other_surface, positions).astype(np.float64)
        back = _transformed(np.linalg.inv(forward), _unproject(other, positions, met))
        returned, returned_depth = _project(camera, back)
        with np.errstate(invalid="ignore"):  # NaN, where the other surface is not to be trusted, compares false
            accepted = np.linalg.norm(returned - centers, axis=1) < settings.max_reprojection_error
            accepted &= np.abs(returned_depth - depth) < settings.max_relative_depth_error * depth
        return Correspondences(first, second, pixels[accepted].astype(np.int32), positions[accepted].astype(np.float32))


@dataclass(frozen=True)
class _Packed:
    """Correspondences in a third of their memory: with hundreds of views they are more than the photographs.

    Attributes:
        first, second: indices of the views.
        width: of the first view.
        tried: rows and columns of its pixels that were tried, `stride` apart.
        matched: one bit for each of them, row by row.
        sides: width and height of the second view.
        positions: (M, 2) uint16, `second_positions` in 65,535ths of these.
    """

    first: int
    second: int
    width: int
    tried: tuple[int, int]
    stride: int
    matched: NDArray[np.uint8]
    sides: tuple[int, int]
    positions: NDArray[np.uint16]

    @classmethod
    def of(cls, found: Correspondences, camera: PinholeCamera, other: PinholeCamera, stride: int) -> _Packed:
        whole = np.zeros((camera.height, camera.width), bool)
        whole.reshape(-1)[found.first_pixels] = True
        matched, sides = whole[::stride, ::stride], (other.width, other.height)
        positions = np.round(found.second_positions / np.asarray(sides, np.float32) * _FINEST).astype(np.uint16)
        tried = (matched.shape[0], matched.shape[1])
        return cls(found.first, found.second, camera.width, tried, stride, np.packbits(matched), sides, positions)

    def unpacked(self) -> Correspondences:
        matched = np.unpackbits(self.matched, count=math.prod(self.tried)).reshape(self.tried)
        rows, columns = np.nonzero(matched)
        pixels = (rows * self.width + columns) * self.stride
        positions = self.positions * (np.asarray(self.sides, np.float32) / _FINEST)
        return Correspondences(self.first, self.second, pixels.astype(np.int32), positions)


def view_pairs(count: int, step: int) -> list[tuple[int, int]]:
    """Pairs (i, i + step) of `count` views in file order."""
    return [(first, first + step) for first in range(count - step)]


def nearest_views(views: Sequence[PosedCamera], among: Sequence[int], count: int) -> dict[int, list[int]]:
    """For each of the views `among`, the `count` others that look most alike, nearest first.

    Nearness is the distance of the centres, in units of the farthest camera's distance from their mean, plus the angle
    between the viewing directions in radians: either changes what is seen.
    """
    poses = [views[index].world_to_camera for index in among]
    centers = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in poses])
    forward = np.stack([pose[2, :3] for pose in poses])
    extent = np.linalg.norm(centers - centers.mean(0), axis=1).max() or 1.0
    distance = np.linalg.norm(centers[:, None] - centers[None], axis=2) / extent
    distance += np.arccos(np.clip(forward @ forward.T, -1.0, 1.0))
    np.fill_diagonal(distance, np.inf)
    order = np.argsort(distance, axis=1, kind="stable")[:, : min(count, len(among) - 1)]
    return {index: [among[other] for other in row] for index, row in zip(among, order, strict=True)}


def sample_bilinear(image: NDArray, positions: NDArray) -> NDArray:
    """Values of an (H, W) or (H, W, C) image at (M, 2) positions x, y; pixel centres lie at +0.5."""
    height, width = image.shape[:2]
    x, y = np.asarray(positions, np.float32).T - np.float32(0.5)
    left, top = np.floor(x), np.floor(y)
    dx, dy = x - left, y - top
    if image.ndim == 3:
        dx, dy = dx[:, None], dy[:, None]
    columns = [np.clip(left + i, 0, width - 1).astype(np.int64) for i in (0, 1)]
    rows = [np.clip(top + i, 0, height - 1).astype(np.int64) * width for i in (0, 1)]
    flat = image.reshape(height * width, *image.shape[2:])
    upper = flat[rows[0] + columns[0]] * (1 - dx) + flat[rows[0] + columns[1]] * dx
    lower = flat[rows[1] + columns[0]] * (1 - dx) + flat[rows[1] + columns[1]] * dx
    return upper * (1 - dy) + lower * dy


def _stride(views: Sequence[PosedCamera]) -> int:
    most = max(view.camera.width * view.camera.height for view in views)
    return max(math.ceil(math.sqrt(most / MOST_TRIED_PIXELS)), 1)


def _trusted_surface(depth: NDArray, alpha: NDArray, settings: CorrespondenceSettings) -> NDArray[np.float32]:
    """(H, W) inverse depth where the surface can be trusted, NaN elsewhere.

    Inverse depth, because bilinear interpolation of it is exact on a plane; NaN, because it spreads to every position
    interpolated from an untrusted pixel.
    """
    trusted = (alpha > settings.min_alpha) & (depth > 0.0) & np.isfinite(depth)
    disparity = np.full(trusted.shape, np.nan)
    disparity[trusted] = 1.0 / depth[trusted].astype(np.float64)
    with np.errstate(invalid="ignore"):
        edge = np.zeros(disparity.shape, bool)
        for axis in (0, 1):
            bend = np.abs(np.diff(disparity, n=2, axis=axis))
            inner = [slice(None), slice(None)]
            inner[axis] = slice(1, -1)
            # NaN compares false: next to what is not covered, coverage is the criterion.
            edge[tuple(inner)] |= bend > settings.max_disparity_bend * disparity[tuple(inner)]
    disparity[maximum_filter(edge, 2 * settings.edge_margin + 1)] = np.nan
    return disparity.astype(np.float32)


def _unproject(camera: PinholeCamera, positions: Floats, depth: Floats) -> Floats:
    """(M, 3) points in the camera's frame at planar depth z."""
    rays = (positions - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return np.concatenate([rays, np.ones((len(rays), 1))], 1) * depth[:, None]


def _project(camera: PinholeCamera, points: Floats) -> tuple[Floats, Floats]:
    """(M, 2) positions and (M,) planar depths of points in the camera's frame."""
    depth = points[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        positions = points[:, :2] / depth[:, None] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    return positions, depth


def _transformed(transform: Floats, points: Floats) -> Floats:
    """(M, 3) points under a (4, 4) rigid transform."""
    return points @ transform[:3, :3].T + transform[:3, 3]
