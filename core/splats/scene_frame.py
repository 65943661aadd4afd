"""The frame in which a scene is trained: cameras around the origin at distance about one. numpy only.

Learning rates and size limits are stated in this frame, so that they mean the same for captures in metres, millimetres
or the arbitrary units of structure from motion, and float32 precision is not lost to a far-away origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from .gaussians import Gaussians

_MOST_CONDITION = 1e4  # of the equations for where axes meet; beyond that they are all but parallel


@dataclass(frozen=True)
class SceneFrame:
    """The similarity ``x_frame = (x_world - origin) * scale``.

    Attributes:
        origin: (3,) in world units.
        scale: frame units per world unit.
    """

    origin: NDArray[np.float64]
    scale: float

    @classmethod
    def around(cls, views: Sequence[View], points: NDArray[np.float32]) -> SceneFrame:
        """The frame whose origin is the mean camera centre and whose unit is the farthest camera's distance from it.

        If the cameras share one centre (a panorama), the unit is the points' median distance from it.
        """
        centers = np.stack([view.center for view in views])
        origin = centers.mean(axis=0)
        extent = float(np.linalg.norm(centers - origin, axis=1).max())
        reach = float(np.median(np.linalg.norm(points - origin, axis=1))) if len(points) else 0.0
        if extent <= 1e-6 * max(reach, float(np.abs(origin).max()), 1e-30):
            extent = reach if reach > 0.0 else 1.0
        return cls(origin, 1.0 / extent)

    def points(self, world: NDArray) -> NDArray[np.float32]:
        """(P, 3) world positions in the frame."""
        return ((world - self.origin) * self.scale).astype(np.float32)

    def world_to_camera(self, world_to_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """The (4, 4) pose for positions in the frame; camera coordinates are scaled as well."""
        pose = world_to_camera.copy()
        pose[:3, 3] = self.scale * (world_to_camera[:3, :3] @ self.origin + world_to_camera[:3, 3])
        return pose

    def pose_to_world(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The inverse of `world_to_camera`."""
        result = pose.copy()
        result[:3, 3] = pose[:3, 3] / self.scale - pose[:3, :3] @ self.origin
        return result

    def to_world(self, gaussians: Gaussians) -> Gaussians:
        """Gaussians of the frame in world units."""
        return replace(
            gaussians,
            means=(gaussians.means / self.scale + self.origin).astype(np.float32),
            log_scales=(gaussians.log_scales - np.log(self.scale)).astype(np.float32),
        )

    def from_world(self, gaussians: Gaussians) -> Gaussians:
        """The inverse of `to_world`."""
        return replace(
            gaussians,
            means=self.points(gaussians.means.astype(np.float64)),
            log_scales=(gaussians.log_scales + np.log(self.scale)).astype(np.float32),
        )


def nearest_to_axes(centers: NDArray[np.float64], axes: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(3,) the place nearest to all optical axes in the sense of least squares; None where these are all but parallel.

    It solves Σ (I - a aᵀ)(x - c) = 0.

    Args:
        centers: (V, 3) of the cameras.
        axes: (V, 3) unit vectors.
    """
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    system = across.sum(axis=0)
    if not np.linalg.cond(system) < _MOST_CONDITION:
        return None
    place: NDArray[np.float64] = np.linalg.solve(system, np.einsum("vij,vj->i", across, centers))
    return place
