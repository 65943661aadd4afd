"""Which pixels of two views show the same surface point: correspondences from depth, coverage and cameras. numpy only.

A pixel's depth is unprojected, projected into the other view, that view's depth is sampled there and projected back.
The pair is accepted when it returns to within a pixel and to the same depth, lies on covered surface in both views and
is not at a depth edge, where rendered depth is a mixture of two surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..events import Reporter
from ..pinhole import PinholeCamera

SHORT_RANGE_STEP = 1
"""Adjacent views, in file order."""

LONG_RANGE_STEP = 7
"""Views so far apart, in file order, test long-range consistency."""

Floats = NDArray[np.float64]


class PosedCamera(Protocol):
    """What is needed of a view; `View` is one."""

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
        edge_margin: pixels around a depth edge that are left out as well.
        stride: only every so many rows and columns of the first view are tried; 1 tries every pixel.
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
        first, second: numbers of the views.
        first_pixels: (M,) int32, flat indices (row * width + column) of pixels in the first view.
        second_positions: (M, 2) float32, x and y in the second view; pixel centres lie at +0.5.
    """

    first: int
    second: int
    first_pixels: NDArray[np.int32]
    second_positions: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.first_pixels)


def view_pairs(count: int, step: int, limit: int | None = None) -> list[tuple[int, int]]:
    """Pairs (i, i + step) of `count` views in file order; at most `limit` of them, evenly spread."""
    pairs = [(first, first + step) for first in range(count - step)]
    if limit is None or len(pairs) <= limit:
        return pairs
    return [pairs[round(index)] for index in np.linspace(0, len(pairs) - 1, limit)]


def find_correspondences(
    depths: Sequence[NDArray],
    alphas: Sequence[NDArray],
    views: Sequence[PosedCamera],
    pairs: Sequence[tuple[int, int]],
    settings: CorrespondenceSettings = CorrespondenceSettings(),
    reporter: Reporter | None = None,
    stage: str = "correspondences",
) -> list[Correspondences]:
    """Correspondences of each pair of views; once per scene, for any number of image sets.

    Args:
        depths: (H, W) planar camera z per view, already divided by alpha; any value where nothing is seen.
        alphas: (H, W) coverage in [0, 1] per view.
        views: the cameras of the depth maps.
        pairs: numbers of the first and the second view.
        settings: when a correspondence is accepted.
        reporter, stage: progress goes there under this name.
    """
    reporter = reporter or Reporter()
    needed = sorted({index for pair in pairs for index in pair})
    surfaces = {index: trusted_surface(depths[index], alphas[index], settings) for index in needed}
    found = []
    for number, (first, second) in enumerate(pairs):
        pixels, positions = match_surfaces(surfaces[first], views[first], surfaces[second], views[second], settings)
        found.append(Correspondences(first, second, pixels, positions))
        reporter.progress(stage, (number + 1) / len(pairs))
    return found


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


def trusted_surface(depth: NDArray, alpha: NDArray, settings: CorrespondenceSettings) -> NDArray[np.float32]:
    """(H, W) inverse depth where the surface can be trusted, NaN elsewhere.

    Inverse depth, because it is what bilinear interpolation gets right on a plane; NaN, because it spreads to every
    position that is interpolated from an untrusted pixel.
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
    disparity[_dilated(edge, settings.edge_margin)] = np.nan
    return disparity.astype(np.float32)


def _dilated(mask: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """The mask grown by `radius` pixels in all eight directions."""
    for _ in range(radius):
        rows = np.pad(mask, ((1, 1), (0, 0)))
        mask = rows[:-2] | rows[1:-1] | rows[2:]
        columns = np.pad(mask, ((0, 0), (1, 1)))
        mask = columns[:, :-2] | columns[:, 1:-1] | columns[:, 2:]
    return mask


def match_surfaces(
    first_surface: NDArray[np.float32],
    first: PosedCamera,
    second_surface: NDArray[np.float32],
    second: PosedCamera,
    settings: CorrespondenceSettings,
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Accepted flat pixel indices (M,) in the first view and positions (M, 2) in the second.

    Args:
        first_surface, second_surface: (H, W) from `trusted_surface`.
    """
    width = first.camera.width
    tried = np.zeros(first_surface.shape, bool)
    tried[:: settings.stride, :: settings.stride] = True
    pixels = np.flatnonzero(tried & np.isfinite(first_surface))
    centers = np.stack([pixels % width, pixels // width], -1) + 0.5
    depth = 1.0 / first_surface.reshape(-1)[pixels].astype(np.float64)

    forward = second.world_to_camera @ np.linalg.inv(first.world_to_camera)
    positions, expected = _project(second.camera, _moved(forward, _unproject(first.camera, centers, depth)))
    inside = (
        (expected > 0.0)
        & (positions >= 0.5).all(1)
        & (positions <= [second.camera.width - 0.5, second.camera.height - 0.5]).all(1)
    )
    pixels, centers, depth, positions = pixels[inside], centers[inside], depth[inside], positions[inside]

    met = 1.0 / sample_bilinear(second_surface, positions).astype(np.float64)
    returned, returned_depth = _project(
        first.camera, _moved(np.linalg.inv(forward), _unproject(second.camera, positions, met))
    )
    with np.errstate(invalid="ignore"):  # NaN, where the other surface is not to be trusted, compares false
        accepted = np.linalg.norm(returned - centers, axis=1) < settings.max_reprojection_error
        accepted &= np.abs(returned_depth - depth) < settings.max_relative_depth_error * depth
    return pixels[accepted].astype(np.int32), positions[accepted].astype(np.float32)


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


def _moved(transform: Floats, points: Floats) -> Floats:
    """(M, 3) points under a (4, 4) rigid transform."""
    return points @ transform[:3, :3].T + transform[:3, 3]
