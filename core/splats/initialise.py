"""The first Gaussians of a scene: from sparse points, and from what views agree on where there are few of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..capture.model import View
from .depth_sweep import DepthSweep
from .gaussians import SH_C0, Gaussians
from .scene_frame import SceneFrame


@dataclass(frozen=True)
class InitialGaussians:
    """How the first Gaussians are made.

    Attributes:
        opacity: of every one; low, so that a wrong one does not hide what lies behind.
        neighbours: an isotropic Gaussian is as large as the mean distance to so many neighbours.
        minimum: with fewer points than this, `sweep` adds to them.
        share: of the most Gaussians that there may be, to start with then.
        most: but no more than so many, since growth finds out by itself how many a scene needs.
        sweep: how further points are found.
    """

    opacity: float = 0.1
    neighbours: int = 3
    minimum: int = 1000
    share: float = 1.0 / 3.0
    most: int = 10_000
    sweep: DepthSweep = field(default_factory=DepthSweep)

    def make(
        self,
        views: Sequence[View],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
        frame: SceneFrame,
        rng: np.random.Generator,
        limit: int,
    ) -> Gaussians:
        """Gaussians of SH degree 0 in `frame`, at most `limit` of them.

        Args:
            views: the training views.
            points: (P, 3) in world units.
            colors: (P, 3) sRGB.
        """
        means, shades = frame.points(points), colors.astype(np.float32) / 255.0
        missing = min(round(self.share * limit), self.most) - len(means)
        if len(means) < self.minimum and missing > 0:
            added, added_shades = self.sweep.sample(views, means, frame, missing, rng)
            means, shades = np.concatenate([means, added]), np.concatenate([shades, added_shades])
        if len(means) > limit:
            chosen = np.sort(rng.choice(len(means), limit, replace=False))
            means, shades = means[chosen], shades[chosen]
        return self._isotropic(means, shades)

    def _isotropic(self, means: NDArray[np.float32], shades: NDArray[np.float32]) -> Gaussians:
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


def _neighbour_distance(means: NDArray[np.float32], neighbours: int) -> NDArray[np.float64]:
    """(N,) mean distance to the nearest neighbours; points that coincide get a thousandth of the median."""
    count = len(means)
    if count < 2:
        return np.full(count, 0.1)
    distance, _ = cKDTree(means).query(means, k=min(neighbours, count - 1) + 1, workers=-1)
    size = distance[:, 1:].mean(axis=1)
    return np.maximum(size, max(1e-3 * float(np.median(size)), 1e-7))
