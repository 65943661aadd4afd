"""The first Gaussians of a scene: from sparse points, or from the cameras' frustums when there are too few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..capture.model import View
from .gaussians import SH_C0, Gaussians
from .scene_frame import SceneFrame


@dataclass(frozen=True)
class InitialGaussians:
    """How the first Gaussians are made.

    Attributes:
        opacity: of every one; low, so that a wrong one does not hide what lies behind.
        neighbours: an isotropic Gaussian is as large as the mean distance to so many neighbours.
        minimum: with fewer points than this, frustum samples are added.
        frustum_samples: how many.
    """

    opacity: float = 0.1
    neighbours: int = 3
    minimum: int = 1000
    frustum_samples: int = 10_000

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
        if len(means) < self.minimum:
            added, added_shades = _sample_frustums(views, means, frame, rng, min(self.frustum_samples, limit))
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


def _sample_frustums(
    views: Sequence[View], known: NDArray[np.float32], frame: SceneFrame, rng: np.random.Generator, count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(count, 3) positions at log-uniform depth behind random pixels, with the pixels' colours in [0, 1]."""
    near, far = _depth_range(views, known, frame)
    depths = np.exp(rng.uniform(np.log(near), np.log(far), count))
    chosen = rng.integers(0, len(views), count)
    means = np.empty((count, 3))
    shades = np.empty((count, 3), np.float32)
    for index, view in enumerate(views):
        mine = np.flatnonzero(chosen == index)
        camera = view.camera
        x, y = rng.uniform(0, camera.width, len(mine)), rng.uniform(0, camera.height, len(mine))
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(len(mine))], axis=1)
        pose = frame.world_to_camera(view.world_to_camera)
        means[mine] = (rays * depths[mine, None] - pose[:3, 3]) @ pose[:3, :3]
        shades[mine] = view.image[y.astype(int), x.astype(int)] / 255.0
    return means.astype(np.float32), shades


def _depth_range(views: Sequence[View], known: NDArray[np.float32], frame: SceneFrame) -> tuple[float, float]:
    """Nearest and farthest depth worth sampling, in frame units.

    From the known points where there are some; else from the point that all optical axes pass nearest to; else, for
    cameras that look the same way, from the baseline.
    """
    poses = np.stack([frame.world_to_camera(view.world_to_camera) for view in views])
    if len(known) >= 8:
        depths = np.einsum("vj,pj->vp", poses[:, 2, :3], known) + poses[:, 2, 3:]
        seen = depths[depths > 0.0]
        if len(seen):
            low, high = np.percentile(seen, [2, 98])
            return float(low) * 0.8, float(high) * 1.25
    centers = -np.einsum("vji,vj->vi", poses[:, :3, :3], poses[:, :3, 3])
    axes = poses[:, 2, :3]
    # Nearest point to all axes: sum over (I - a aᵀ)(x - c) = 0.
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    system = across.sum(axis=0)
    if np.linalg.cond(system) < 1e4:
        focus = np.linalg.solve(system, np.einsum("vij,vj->i", across, centers))
        depths = np.einsum("vj,vj->v", focus - centers, axes)
        if (depths > 0.0).mean() > 0.8:
            distance = float(np.median(depths[depths > 0.0]))
            return 0.4 * distance, 2.5 * distance
    return 0.5, 20.0
