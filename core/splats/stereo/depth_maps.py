"""Depth maps of posed photographs: which views are compared with which, at which depths, and the comparison itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...capture.model import PinholeCamera, View
from ...runtime.resources import available_processors
from ..raster.workers import WorkerPool
from .kernels import MOST_NEIGHBOURS, StereoState, scratch_floats, stereo

Floats = NDArray[np.float32]

_ANCHORS = 6  # a side: pixels by which overlap is measured
_ANCHOR_DEPTHS = 3  # at each of them
_CANDIDATES = 64  # nearest cameras among which neighbours are looked for
_FEW_DEPTHS = 30  # points in an image, fewer of which do not tell its range
_TAILS = (1.0, 99.0)  # percentiles of their depths
_MARGIN = 1.3  # beyond them
_UNLIKE = 1.0  # cost where no neighbour has the place in its image: as much as no correlation


@dataclass(frozen=True)
class StereoPlan:
    """How depth maps are computed.

    Attributes:
        side: longer side, in pixels, to which the photographs of `usual_views` views are reduced: cost grows with its
            third power, so that fewer views are compared in more detail.
        usual_views: see `side`.
        smallest_side, largest_side: bounds of that.
        levels: inverse depths tried for each pixel of a photograph of 80 pixels; as many more as it is larger.
        neighbours: views with which a view is compared; the half that agrees best counts, others may be occluded.
        best_angle: in degrees, between the rays of two views to one place. Smaller ones hardly tell depths apart.
        narrow, wide: standard deviations, in degrees, of what is still good below and above it.
        noise: variance of grey values in [0, 1] that is not taken for texture.
        color_weight: of the mean difference in colour, from 0 to 1, beside 1 - correlation.
        most_difference: in colour that counts.
        small_step, large_step: costs of a change by one level, and by more, between neighbouring pixels.
        evidence: smoothed cost by which the best level has to be below the mean of all: no less than a jump, so that
            plain surfaces get a depth from what surrounds them, or none.
    """

    side: int = 80
    usual_views: int = 128
    smallest_side: int = 64
    largest_side: int = 160
    levels: int = 64
    neighbours: int = 6
    best_angle: float = 8.0
    narrow: float = 4.0
    wide: float = 15.0
    noise: float = (2.0 / 255.0) ** 2
    color_weight: float = 0.5
    most_difference: float = 0.2
    small_step: float = 0.03
    large_step: float = 0.25
    evidence: float = 0.25

    def side_for(self, views: int) -> float:
        """Pixels of the longer side for a number of views."""
        side = self.side * (self.usual_views / max(views, 1)) ** (1.0 / 3.0)
        return min(max(side, self.smallest_side), self.largest_side)


@dataclass(frozen=True)
class StereoView:
    """A view reduced for stereo.

    Attributes:
        image: (H, W, 4) float32: red, green and blue in [0, 1], and the share that is covered and not masked.
        camera: of the reduced image.
        pose: (4, 4) world to camera.
    """

    image: Floats
    camera: PinholeCamera
    pose: NDArray[np.float64]

    @classmethod
    def of(cls, view: View, pose: NDArray[np.float64], side: float) -> StereoView:
        """`view` from `pose`, reduced by a whole factor to at most `side` pixels."""
        full = view.camera
        factor = max(-(-max(full.width, full.height) // int(side)), 1)
        factor = min(factor, max(min(full.width, full.height) // 2, 1))  # two pixels at least
        height, width = full.height // factor, full.width // factor
        layers = np.concatenate([view.image, _alpha(view)[..., None]], axis=2)[: height * factor, : width * factor]
        blocks = layers.reshape(height, factor, width, factor, 4)
        camera = PinholeCamera(width, height, full.fx / factor, full.fy / factor, full.cx / factor, full.cy / factor)
        return cls(blocks.mean(axis=(1, 3), dtype=np.float32) / np.float32(255.0), camera, pose)

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) of the camera."""
        return -self.pose[:3, :3].T @ self.pose[:3, 3]

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """(3, 3) of the reduced image."""
        c = self.camera
        return np.array([[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]])

    def unproject(self, x: NDArray, y: NDArray, depth: NDArray) -> NDArray[np.float64]:
        """(..., 3) places at `depth` on the rays of pixels (x, y), whose centres are at +0.5."""
        c = self.camera
        local = np.stack(np.broadcast_arrays((x - c.cx) / c.fx * depth, (y - c.cy) / c.fy * depth, depth), axis=-1)
        return (local - self.pose[:3, 3]) @ self.pose[:3, :3]

    def project(self, places: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """(..., 2) pixels, (...) depths, and whether (..., 3) places are in the image."""
        c = self.camera
        local = places @ self.pose[:3, :3].T + self.pose[:3, 3]
        depth = local[..., 2]
        ahead = np.where(depth > 1e-9, depth, np.inf)
        pixels = local[..., :2] / ahead[..., None] * (c.fx, c.fy) + (c.cx, c.cy)
        return pixels, depth, (depth > 1e-9) & ((pixels >= 0.0) & (pixels < (c.width, c.height))).all(axis=-1)


@dataclass(frozen=True)
class DepthMaps:
    """What stereo found.

    Attributes:
        views: V of them.
        neighbours: (V, K) indices of the views with which each was compared, -1 after the last.
        inverse_depths: (H, W) of each view; 0 where it is not covered, or nothing tells.
    """

    views: Sequence[StereoView]
    neighbours: NDArray[np.int32]
    inverse_depths: Sequence[Floats]


def compute_depth_maps(
    views: Sequence[StereoView], ranges: NDArray[np.float64], plan: StereoPlan, threads: int | None = None
) -> DepthMaps:
    """Depth maps of all views, which have neighbours if they overlap any other view.

    Args:
        ranges: (V, 2) nearest and farthest depth of each view between which surfaces are looked for.
        threads: None takes all processors that this process may use; the result is the same.
    """
    neighbours = choose_neighbours(views, ranges, plan)
    largest = max(max(view.image.shape[:2]) for view in views)
    levels = max(round(plan.levels * largest / 80 / 8), 4) * 8
    first = 1.0 / ranges[:, 1]
    step = (1.0 / ranges[:, 0] - first) / (levels - 1)
    counts = [view.camera.width * view.camera.height for view in views]
    starts = np.concatenate([[0], np.cumsum(counts)])
    workers = min(threads or available_processors(), len(views))
    floats = scratch_floats(max(counts), levels)
    arrays = {
        "counter": np.zeros(1, np.int32),
        "sizes": np.array([(view.camera.width, view.camera.height) for view in views], np.int32),
        "first_pixel": starts[:-1].astype(np.int32),
        "images": np.concatenate([view.image.reshape(-1, 4) for view in views]),
        "neighbours": neighbours,
        "pairs": _homographies(views, neighbours),
        "ranges": np.stack([first, step], axis=1).astype(np.float32),
        "scratch": np.zeros(workers * floats, np.float32),
        "inverse_depth": np.zeros(starts[-1], np.float32),
    }
    state = StereoState()
    held = {name: wp.array(value, device="cpu", copy=False) for name, value in arrays.items()}
    for name, array in held.items():
        setattr(state, name, array)
    state.views, state.levels, state.most_pixels = len(views), levels, max(counts)
    state.neighbour_count, state.scratch_floats = neighbours.shape[1], floats
    state.noise, state.color_weight, state.most_difference = plan.noise, plan.color_weight, plan.most_difference
    state.unseen, state.small_step, state.large_step = _UNLIKE, plan.small_step, plan.large_step
    state.evidence = plan.evidence
    launches = [
        wp.launch(stereo, 1, inputs=[state, worker], device="cpu", record_cmd=True).launch for worker in range(workers)
    ]
    WorkerPool(workers).run(launches)
    shapes = [view.image.shape[:2] for view in views]
    split = partial(_split, starts=starts, shapes=shapes)
    return DepthMaps(views, neighbours, split(arrays["inverse_depth"]))


def depth_ranges(views: Sequence[StereoView], known: Floats, usual: tuple[float, float]) -> NDArray[np.float64]:
    """(V, 2) nearest and farthest depth worth trying in each view.

    Args:
        known: (P, 3) points on surfaces; those in a view's image tell its range, those of all views where it has few.
        usual: the range if there are few in all.
    """
    depths = []
    for view in views:
        _, depth, inside = view.project(known)
        depths.append(depth[inside])
    everywhere = np.concatenate(depths)
    result = np.zeros((len(views), 2))
    for index, own in enumerate(depths):
        told = own if len(own) >= _FEW_DEPTHS else everywhere
        low, high = np.percentile(told, _TAILS) if len(told) >= _FEW_DEPTHS else usual
        result[index] = (low / _MARGIN, high * _MARGIN) if len(told) >= _FEW_DEPTHS else usual
    return result


def choose_neighbours(views: Sequence[StereoView], ranges: NDArray[np.float64], plan: StereoPlan) -> NDArray[np.int32]:
    """(V, K) the views that show the same places from the most useful angles, best first, -1 after the last.

    The places are a grid of pixels at a few depths within the (V, 2) ranges.
    """
    count = min(plan.neighbours, MOST_NEIGHBOURS, max(len(views) - 1, 1))
    centers = np.stack([view.center for view in views])
    candidates = cKDTree(centers).query(centers, k=min(_CANDIDATES + 1, len(views)))[1].reshape(len(views), -1)
    share = (np.arange(_ANCHORS) + 0.5) / _ANCHORS
    chosen = np.full((len(views), count), -1, np.int32)
    for index, view in enumerate(views):
        near, far = ranges[index]
        depths = np.geomspace(near, far, _ANCHOR_DEPTHS + 2)[1:-1]
        x, y, depth = np.meshgrid(share * view.camera.width, share * view.camera.height, depths, indexing="ij")
        places = view.unproject(x, y, depth).reshape(-1, 3)
        others = [int(i) for i in candidates[index] if i != index]
        scores = np.array([_usefulness(places, view, views[i], plan) for i in others])
        best = np.argsort(-scores, kind="stable")[:count]
        best = best[scores[best] > 0.0]
        chosen[index, : len(best)] = np.asarray(others, np.int32)[best] if len(best) else []
    return chosen


def _usefulness(places: NDArray, view: StereoView, other: StereoView, plan: StereoPlan) -> float:
    """The share of (P, 3) places that `other` shows, weighted by the angle between the rays to them."""
    inside = other.project(places)[2]
    if not inside.any():
        return 0.0
    rays, theirs = places[inside] - view.center, places[inside] - other.center
    cosine = (rays * theirs).sum(axis=1) / (np.linalg.norm(rays, axis=1) * np.linalg.norm(theirs, axis=1) + 1e-30)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    off = angle - plan.best_angle
    worth = np.exp(-0.5 * (off / np.where(off < 0.0, plan.narrow, plan.wide)) ** 2)
    return float(np.where(angle > 1e-3, worth, 0.0).sum())


def _homographies(views: Sequence[StereoView], neighbours: NDArray[np.int32]) -> Floats:
    """(V, K, 12) matrix A and column b: pixel x of a view is A x + b / depth in its neighbour, homogeneously."""
    result = np.zeros((*neighbours.shape, 12), np.float32)
    for index, view in enumerate(views):
        for slot, other in enumerate(neighbours[index]):
            if other < 0:
                break
            relative = views[other].pose @ np.linalg.inv(view.pose)
            matrix = views[other].intrinsics @ relative[:3, :3] @ np.linalg.inv(view.intrinsics)
            result[index, slot, :9] = matrix.ravel()
            result[index, slot, 9:] = views[other].intrinsics @ relative[:3, 3]
    return result


def _split(flat: Floats, starts: NDArray, shapes: Sequence[tuple[int, ...]]) -> list[Floats]:
    return [flat[a:b].reshape(shape) for a, b, shape in zip(starts[:-1], starts[1:], shapes, strict=True)]


def _alpha(view: View) -> NDArray[np.uint8]:
    shown = view.shown
    return np.full(view.image.shape[:2], 255, np.uint8) if shown is None else shown
