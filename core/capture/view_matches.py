"""What views show in common: SIFT features of their pictures, matched and verified pair by pair, and how it fits poses.

This asks whether cameras that came with photographs are right; cameras that are missing are estimated from files, in a
process of their own (`sfm`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray

from ..intake.sampling import evenly_spread
from .epipolar import sampson_distances
from .model import PinholeCamera, View
from .scaling import downscale_with_alpha, fit_size

Pair = tuple[int, int]
"""Indices of two views, the smaller first."""

_SIDE = 640  # pixels of the longer side
_MOST_FEATURES = 2048  # of a view
_RATIO = 0.8  # of the distances to the best and to the second best descriptor (Lowe 2004)
_VERIFIED = 1.5  # pixels from the epipolar line, up to which RANSAC counts a match
_LEAST_MATCHES = 15  # of a pair; RANSAC finds fewer by chance
_FITS = 2.0  # pixels, up to which poses explain a match
_SAMPLED = 8  # pairs
_LEAST_PAIRS = 3  # of those, in which something is found
_NEAR, _FURTHER = 8, 6  # neighbours of a view: all of the nearest, and some from four times as many
_TURN = 2.0  # a right angle between directions of view, in units of the cameras' spread


class ViewMatches:
    """Features of views and what pairs of them have in common, found when it is first asked for.

    Args:
        views: with pictures; what their masks leave out has no features.
        seed: of RANSAC.

    Attributes:
        views: as given.
        cameras: theirs, for pictures of the size in which features are sought: at most `_SIDE` pixels.
    """

    def __init__(self, views: Sequence[View], seed: int) -> None:
        self.views = views
        self.cameras = [view.camera.scaled(*fit_size(view.camera.width, view.camera.height, _SIDE)) for view in views]
        pycolmap.logging.minloglevel = int(pycolmap.logging.Level.ERROR.value)  # it tells of every extractor
        options = pycolmap.FeatureExtractionOptions()
        options.sift.max_num_features = _MOST_FEATURES
        self._sift = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
        self._ransac = pycolmap.RANSACOptions(max_error=_VERIFIED, random_seed=seed)
        self._features: dict[int, tuple[NDArray[np.float64], NDArray[np.float32]]] = {}
        self._common: dict[Pair, NDArray[np.int64]] = {}

    def positions(self, view: int) -> NDArray[np.float64]:
        """(F, 2) places of a view's features in pixels of its camera in `cameras`, centres at +0.5."""
        return self._features_of(view)[0]

    def color(self, view: int, feature: int) -> NDArray[np.uint8]:
        """(3,) sRGB of a view's picture where a feature is."""
        image = self.views[view].image
        across, down = self.positions(view)[feature] / self._size(view)
        return image[int(down * image.shape[0]), int(across * image.shape[1])]

    def common(self, pair: Pair) -> NDArray[np.int64]:
        """(n, 2) numbers of features that show the same in two views; none where they are too few to be believed."""
        if pair not in self._common:
            self._common[pair] = self._verified(pair, self._matched(pair))
        return self._common[pair]

    def share_that_fits(self, pair: Pair, poses: Sequence[NDArray[np.float64]]) -> float:
        """The share of what a pair has in common that fits (4, 4) world-to-camera poses; NaN where there is nothing."""
        found = self.common(pair)
        if not len(found):
            return np.nan
        cameras = [self.cameras[view] for view in pair]
        first, second = (
            on_plane(camera, self.positions(view)[found[:, side]])
            for side, (view, camera) in enumerate(zip(pair, cameras, strict=True))
        )
        start, end = (pycolmap.Rigid3d(poses[view][:3]) for view in pair)
        distances = sampson_distances(first, second, end * start.inverse()) * np.mean([lens.fx for lens in cameras])
        return float(np.mean(distances < _FITS))

    def _features_of(self, view: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        if view not in self._features:
            width, height = self._size(view)
            picture, shown = self.views[view].image, self.views[view].shown
            picture, shown = downscale_with_alpha(picture, shown, width, height)
            grey = np.rint(picture @ np.array([0.299, 0.587, 0.114]))
            keypoints, found = self._sift.extract_from_uint8_array(np.ascontiguousarray(grey, dtype=np.uint8))
            positions = np.array([(keypoint.x, keypoint.y) for keypoint in keypoints], np.float64).reshape(-1, 2)
            descriptors = found.data.astype(np.float32)
            if shown is not None:
                seen = shown[tuple(positions.astype(int).T[::-1])] > 0
                positions, descriptors = positions[seen], descriptors[seen]
            self._features[view] = positions, descriptors
        return self._features[view]

    def _size(self, view: int) -> tuple[int, int]:
        return self.cameras[view].width, self.cameras[view].height

    def _matched(self, pair: Pair) -> NDArray[np.int64]:
        """(n, 2) numbers of features that are each other's only good match."""
        import torch
        from kornia.feature import match_smnn

        first, second = (torch.from_numpy(self._features_of(view)[1]) for view in pair)
        if min(len(first), len(second)) < _LEAST_MATCHES:
            return np.zeros((0, 2), np.int64)
        return match_smnn(first, second, _RATIO)[1].numpy()

    def _verified(self, pair: Pair, matched: NDArray[np.int64]) -> NDArray[np.int64]:
        """Those of (n, 2) matches that agree on one relative pose, whichever it is."""
        if len(matched) >= _LEAST_MATCHES:
            first, second = (self.positions(view)[matched[:, side]] for side, view in enumerate(pair))
            found = pycolmap.estimate_fundamental_matrix(first, second, self._ransac)
            if found is not None and found["num_inliers"] >= _LEAST_MATCHES:
                return matched[np.asarray(found["inlier_mask"])]
        return matched[:0]


def on_plane(camera: PinholeCamera, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) places in pixels as x / z and y / z in camera axes."""
    return (positions - (camera.cx, camera.cy)) / (camera.fx, camera.fy)


def poses_of(views: Iterable[View]) -> list[NDArray[np.float64]]:
    """(4, 4) world-to-camera of each view."""
    return [view.world_to_camera for view in views]


def agreement(matches: ViewMatches, poses: Sequence[NDArray[np.float64]]) -> float:
    """Of a few neighbouring views, the mean share of what a pair has in common that fits (4, 4) world-to-camera poses.

    Right cameras of this project's captures have .95 to 1, at 160 and at 480 pixels; turned by 2°, 0 to .7.

    Returns:
        NaN where too little is found to tell.
    """
    pairs = [near[min(1, len(near) - 1)] for near in evenly_spread(neighbours(poses), _SAMPLED) if near]
    shares = [matches.share_that_fits(pair, poses) for pair in dict.fromkeys(pairs)]
    known = [share for share in shares if not np.isnan(share)]
    return float(np.mean(known)) if len(known) >= _LEAST_PAIRS else np.nan


def neighbours(poses: Sequence[NDArray[np.float64]]) -> list[list[Pair]]:
    """For the view of each (4, 4) world-to-camera pose the pairs with others that are likely to show the same.

    The nearest come first: cameras that stand close and look the same way. Poses that are roughly right tell that.
    """
    stacked = np.stack(poses)
    centers, ahead = -np.einsum("vji,vj->vi", stacked[:, :3, :3], stacked[:, :3, 3]), stacked[:, 2, :3]
    spread = float(np.sqrt(centers.var(axis=0).sum())) or 1.0
    found = []
    for view in range(len(poses)):
        apart = np.linalg.norm(centers - centers[view], axis=1) / spread + _TURN * (1.0 - ahead @ ahead[view])
        apart[view] = np.inf
        order = np.argsort(apart, kind="stable")[: len(poses) - 1].tolist()
        chosen = [*order[:_NEAR], *evenly_spread(order[_NEAR : 4 * _NEAR], _FURTHER)]
        found.append([(min(view, other), max(view, other)) for other in chosen])
    return found
