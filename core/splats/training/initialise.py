"""Initialisation of the Gaussians: from sparse points, from dense stereo and, if both give few, from a depth sweep.

The sweep finds points on surfaces: pixels at the depths at which other views show the same colour. It is a plane sweep
(Collins 1996) of single pixels instead of planes: many depths are tried along a pixel's ray, and each is scored by the
colour difference in the nearest views, which see the same place from elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from ...capture.model import View
from ..gaussians import SH_C0, Gaussians
from ..scene_frame import SceneFrame, nearest_to_axes
from ..stereo import DensePoints, StereoPlan, StereoView, agreeing, compute_depth_maps, thinned
from ..stereo.depth_maps import depth_ranges

_UNCOVERED_DIFFERENCE = 255.0  # of a place that is not covered in another view
_COVERED = 128  # alpha from which a pixel counts as covered


@dataclass(frozen=True)
class DepthSweep:
    """How depths are found.

    Attributes:
        depths: tried for each pixel, evenly spaced in their logarithm.
        views: nearest ones, which are compared. The half that agrees best counts: the others may be occluded.
        side: longer side, in pixels, to which photographs are reduced before colours are compared.
        width: of the square, in reduced pixels, over which colours are averaged.
        guides: known points nearest to a pixel in the image; their depth is tried as well, and taken if no colour
            tells depths apart. More weight than that would draw plain walls to what stands in front of them.
    """

    depths: int = 32
    views: int = 10
    side: int = 320
    width: int = 3
    guides: int = 4

    def sample(
        self, views: Sequence[View], known: NDArray[np.float32], frame: SceneFrame, count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(N, 3) positions in `frame` and (N, 3) colours in [0, 1] of randomly chosen covered pixels.

        N is `count` unless photographs are empty. A pixel whose place no other view shows gets a random depth.

        Args:
            known: (P, 3) points on surfaces, in `frame`; P may be 0.
        """
        poses = np.stack([frame.world_to_camera(view.world_to_camera) for view in views])
        near, far = _depth_range(poses, known)
        grid = np.linspace(np.log(near), np.log(far), self.depths)
        swept = [_SweptView(view, pose, self.side, self.width) for view, pose in zip(views, poses, strict=True)]
        centers = np.stack([view.center for view in swept])
        nearest = cKDTree(centers).query(centers, k=min(self.views + 1, len(views)))[1].reshape(len(views), -1)
        shares = np.bincount(rng.integers(0, len(views), count), minlength=len(views))
        means, shades = [np.zeros((0, 3))], [np.zeros((0, 3))]
        for index, share in enumerate(shares):
            view = swept[index]
            pixels = view.random_pixels(share, rng)
            guide = _guide(view, known, pixels, self.guides)
            # The first depth wins ties: it is taken if nothing tells the depths apart.
            first = rng.uniform(grid[0], grid[-1], len(pixels)) if guide is None else guide
            log_depths = np.concatenate([first[:, None], np.tile(grid, (len(pixels), 1))], axis=1)
            places = view.unproject(pixels, np.exp(log_depths))
            difference = _difference(places, view.colors(pixels), [swept[i] for i in nearest[index] if i != index])
            best = difference.argmin(axis=1)
            means.append(places[np.arange(len(pixels)), best])
            shades.append(view.exact_colors(pixels) / 255.0)
        return np.concatenate(means).astype(np.float32), np.concatenate(shades).astype(np.float32)


@dataclass(frozen=True)
class DenseStart:
    """How points are found by dense stereo where there are no sparse ones.

    Attributes:
        share: of the limit, up to which Gaussians are added to the sparse points. Starts of a third of that end 0.7 dB
            lower in a room, since growth divides what is there and does not reach what is missing.
        least: share of the start that points of dense stereo should be where sparse ones are many: however many these
            are, others are where they are not. Sparse points make room for them if the limit leaves none.
        tolerance: relative difference of two views' depths that still agree.
        agreeing: views that have to confirm a depth.
        stereo: how depths are found.
    """

    share: float = 0.5
    least: float = 1.0 / 3.0
    tolerance: float = 0.05
    agreeing: int = 2
    stereo: StereoPlan = field(default_factory=StereoPlan)

    def points(self, views: Sequence[View], known: NDArray[np.float32], frame: SceneFrame, limit: int) -> DensePoints:
        """Points beside the (P, 3) known ones, in `frame`; with them there may be more than the limit."""
        missing = self.missing(len(known), limit)
        if missing <= 0 or len(views) < 2:
            return DensePoints.none()
        side = self.stereo.side_for(len(views))
        reduced = [StereoView.of(view, frame.world_to_camera(view.world_to_camera), side) for view in views]
        usual = _depth_range(np.stack([view.pose for view in reduced]), known)
        maps = compute_depth_maps(reduced, depth_ranges(reduced, known, usual), self.stereo)
        return thinned(agreeing(maps, self.tolerance, self.agreeing), missing, known)

    def missing(self, known: int, limit: int) -> int:
        """How many points a start with this number of known ones lacks."""
        many = min(round(known / (1.0 - self.least)), limit)  # with `least` of them from dense stereo
        return max(round(self.share * limit) - known, round(self.least * many))


@dataclass(frozen=True)
class InitialGaussians:
    """How the Gaussians are initialised.

    Attributes:
        opacity: low, so that a misplaced Gaussian does not hide what lies behind.
        neighbours: whose mean distance is the standard deviation of an isotropic Gaussian.
        minimum: number of points below which `sweep` adds to them.
        share: of the limit, to start with in that case.
        most: upper bound of that number, since growth finds how many a scene needs.
        sweep: how further points are found.
        dense: how points are added to the sparse ones by dense stereo; None to leave it.
    """

    opacity: float = 0.1
    neighbours: int = 3
    minimum: int = 1000
    share: float = 1.0 / 3.0
    most: int = 10_000
    sweep: DepthSweep = field(default_factory=DepthSweep)
    dense: DenseStart | None = None

    def make(
        self,
        views: Sequence[View],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
        frame: SceneFrame,
        rng: np.random.Generator,
        limit: int,
    ) -> Gaussians:
        """At most `limit` Gaussians of SH degree 0 in `frame`.

        Args:
            views: the training views.
            points: (P, 3) in world units.
            colors: (P, 3) sRGB.
        """
        means, shades = frame.points(points), colors.astype(np.float32) / 255.0
        found = self.dense.points(views, means, frame, limit) if self.dense else DensePoints.none()
        room = limit - len(found)
        if len(means) > room:
            chosen = np.sort(rng.choice(len(means), room, replace=False))
            means, shades = means[chosen], shades[chosen]
        means, shades = np.concatenate([means, found.positions]), np.concatenate([shades, found.colors])
        missing = min(round(self.share * limit), self.most) - len(means)
        if len(means) < self.minimum and missing > 0:
            added, added_shades = self.sweep.sample(views, means, frame, missing, rng)
            means, shades = np.concatenate([means, added]), np.concatenate([shades, added_shades])
        return self.isotropic(means, shades)

    def again(self, gaussians: Gaussians) -> Gaussians:
        """Gaussians to begin anew with, at the means of `gaussians` and in their colours."""
        shades = np.minimum(gaussians.base_colors, 1.0)
        return self.isotropic(gaussians.means, shades).with_sh_degree(gaussians.sh_degree)

    def isotropic(self, means: NDArray[np.float32], shades: NDArray[np.float32]) -> Gaussians:
        """A round, faint Gaussian at each of (P, 3) `means`, in colours `shades`, (P, 3) sRGB from 0 to 1."""
        count = len(means)
        size = _neighbour_distance(means, self.neighbours)
        quaternions = np.zeros((count, 4), np.float32)
        quaternions[:, 0] = 1.0
        return Gaussians(
            means=np.ascontiguousarray(means, np.float32),
            log_scales=np.repeat(np.log(size)[:, None], 3, axis=1).astype(np.float32),
            quaternions=quaternions,
            opacity_logits=np.full(count, np.log(self.opacity / (1.0 - self.opacity)), np.float32),
            sh=((shades - 0.5) / SH_C0).astype(np.float32)[:, None, :],
        )


class _SweptView:
    """A view in the frame, prepared for colour look-ups; see `DepthSweep` for `side` and `width`."""

    def __init__(self, view: View, pose: NDArray[np.float64], side: int, width: int) -> None:
        self._view, self._shown = view, view.shown
        self._rotation, self._translation = pose[:3, :3], pose[:3, 3]
        self._every = -(-max(view.camera.width, view.camera.height) // side)
        smooth = uniform_filter(view.image, (width * self._every, width * self._every, 0))
        self._smooth = smooth[self._every // 2 :: self._every, self._every // 2 :: self._every].copy()

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) of the camera."""
        return -self._rotation.T @ self._translation

    def random_pixels(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """(count, 2) random x and y in the covered part of the image; none if nothing is covered."""
        camera, alpha = self._view.camera, self._shown
        if alpha is None:
            return rng.uniform(0.0, 1.0, (count, 2)) * (camera.width, camera.height)
        covered = np.argwhere(alpha >= _COVERED)[:, ::-1]
        if not len(covered):
            return np.zeros((0, 2))
        return covered[rng.integers(0, len(covered), count)] + rng.uniform(0.0, 1.0, (count, 2))

    def unproject(self, pixels: NDArray[np.float64], depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, D, 3) positions of (N, 2) pixels at (N, D) depths."""
        camera = self._view.camera
        rays = np.ones((len(pixels), 1, 3))
        rays[:, 0, :2] = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        return (rays * depths[:, :, None] - self._translation) @ self._rotation

    def project(self, positions: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray]:
        """(..., 2) pixels, (...) depths, and whether each of (..., 3) positions is in the image."""
        camera = self._view.camera
        local = positions @ self._rotation.T + self._translation
        depths = local[..., 2]
        in_front = np.where(depths > 1e-6, depths, np.inf)
        pixels = local[..., :2] / in_front[..., None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        inside = (depths > 1e-6) & (pixels >= 0.0).all(axis=-1) & (pixels < (camera.width, camera.height)).all(axis=-1)
        return pixels, depths, inside

    def colors(self, pixels: NDArray[np.float64]) -> NDArray[np.float32]:
        """(..., 3) averaged colours at (..., 2) pixels in the image, 0 to 255; NaN where not covered."""
        height, width = self._smooth.shape[:2]
        x = np.minimum((pixels[..., 0] / self._every).astype(int), width - 1)
        y = np.minimum((pixels[..., 1] / self._every).astype(int), height - 1)
        return np.where(self._covered(pixels)[..., None], self._smooth[y, x], np.float32(np.nan))

    def exact_colors(self, pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
        """(N, 3) colours of the photograph at (N, 2) pixels in the image."""
        x, y = pixels.astype(int).T
        return self._view.image[y, x]

    def _covered(self, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
        x, y = pixels.astype(int)[..., 0], pixels.astype(int)[..., 1]
        if self._shown is None:
            return np.ones(x.shape, bool)
        return self._shown[y, x] >= _COVERED


def _difference(
    places: NDArray[np.float64], colors: NDArray[np.float32], others: Sequence[_SweptView]
) -> NDArray[np.float64]:
    """(N, D) mean difference between (N, 3) colours and those of the best half of `others` at (N, D, 3) places.

    Higher than any difference where fewer than two of them have the place in the image, and 0 without others.
    """
    if not others:
        return np.zeros(places.shape[:2])
    found = np.full((len(others), *places.shape[:2]), np.inf)
    for difference, other in zip(found, others, strict=True):
        pixels, _, inside = other.project(places)
        expected = np.broadcast_to(colors[:, None], places.shape)[inside]
        seen = np.abs(other.colors(pixels[inside]) - expected).mean(axis=-1)
        difference[inside] = np.where(np.isnan(seen), _UNCOVERED_DIFFERENCE, seen)
    counts = np.isfinite(found).sum(axis=0)
    found.sort(axis=0)
    halves = np.maximum((counts + 1) // 2, 1)
    sums = np.cumsum(np.where(np.isfinite(found), found, 0.0), axis=0)
    mean = np.take_along_axis(sums, halves[None] - 1, axis=0)[0] / halves
    return np.where(counts < min(2, len(others)), 2.0 * _UNCOVERED_DIFFERENCE, mean)


def _guide(
    view: _SweptView, known: NDArray[np.float32], pixels: NDArray[np.float64], count: int
) -> NDArray[np.float64] | None:
    """(N,) log depth at (N, 2) pixels, from the known points nearest to them in the image; None if too few."""
    positions, depths, inside = view.project(known)
    if inside.sum() < count or not len(pixels):
        return None
    distances, neighbours = cKDTree(positions[inside]).query(pixels, k=count)
    weights = 1.0 / (distances + 1e-3)
    return (weights * np.log(depths[inside])[neighbours]).sum(axis=1) / weights.sum(axis=1)


def _depth_range(poses: NDArray[np.float64], known: NDArray[np.float32]) -> tuple[float, float]:
    """Nearest and farthest depth worth trying, in frame units.

    From the known points if there are enough; else from the point nearest to all optical axes; else, for cameras that
    look the same way, from the baseline.
    """
    if len(known) >= 8:
        depths = np.einsum("vj,pj->vp", poses[:, 2, :3], known) + poses[:, 2, 3:]
        seen = depths[depths > 0.0]
        if len(seen):
            low, high = np.percentile(seen, [2, 98])
            return float(low) * 0.8, float(high) * 1.25
    centers = -np.einsum("vji,vj->vi", poses[:, :3, :3], poses[:, :3, 3])
    axes = poses[:, 2, :3]
    focus = nearest_to_axes(centers, axes)
    if focus is not None:
        depths = np.einsum("vj,vj->v", focus - centers, axes)
        if (depths > 0.0).mean() > 0.8:
            distance = float(np.median(depths[depths > 0.0]))
            return 0.4 * distance, 2.5 * distance
    return 0.5, 20.0


def _neighbour_distance(means: NDArray[np.float32], neighbours: int) -> NDArray[np.float64]:
    """(N,) mean distance to the nearest neighbours, at least a thousandth of the median, for coinciding points."""
    count = len(means)
    if count < 2:
        return np.full(count, 0.1)
    distance, _ = cKDTree(means).query(means, k=min(neighbours, count - 1) + 1, workers=-1)
    size = distance[:, 1:].mean(axis=1)
    return np.maximum(size, max(1e-3 * float(np.median(size)), 1e-7))
