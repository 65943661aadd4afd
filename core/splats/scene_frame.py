"""The frame in which a scene is trained: cameras around the origin at distance about one. numpy only.

Learning rates and size limits are stated in this frame, so that they mean the same for captures in metres, millimetres
or the arbitrary units of structure from motion, and float32 precision is not lost to a far-away origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..capture.folder import CaptureView
from ..capture.model import PinholeCamera, View
from .gaussians import Gaussians

NEAR = 0.05
"""Smallest depth that is drawn, in units of the frame."""
_MOST_CONDITION = 1e4  # of the equations for where axes meet; beyond that they are all but parallel
# The unit in typical depths, at most: the capture of an object has a unit of 0.4 to 0.9 of them, that of a room of up
# to 2. On a longer way, or with one camera far from the others, the near plane would cut off what is looked at.
_MOST_DEPTHS = 3.0
_SAMPLED = 2000  # points by which depths are measured


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
        """The frame whose origin is the mean camera centre and whose unit is `unit_of_length`."""
        unit = unit_of_length([view.world_to_camera for view in views], [view.camera for view in views], points)
        return cls(np.stack([view.center for view in views]).mean(axis=0), 1.0 / unit)

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


def unit_of_length(
    poses: Sequence[NDArray[np.float64]], cameras: Sequence[PinholeCamera], points: NDArray[np.floating]
) -> float:
    """The farthest camera's distance from the mean of all, world units, but at most three typical depths.

    If the cameras share one centre (a panorama), it is the points' median distance from that.

    Args:
        poses: world to camera, (4, 4) each, OpenCV axes; at least one.
        cameras: their intrinsics.
        points: (P, 3) of the scene, world units; P may be 0.
    """
    centers = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in poses])
    origin = centers.mean(axis=0)
    extent = float(np.linalg.norm(centers - origin, axis=1).max())
    reach = float(np.median(np.linalg.norm(points - origin, axis=1))) if len(points) else 0.0
    if extent <= max(1e-6 * reach, 1e-9 * float(np.abs(origin).max()), 1e-30):
        return reach if reach > 0.0 else 1.0
    depths = [_typical_depth(pose, camera, points) for pose, camera in zip(poses, cameras, strict=True)]
    seen = [depth for depth in depths if depth > 0.0]
    return min(extent, _MOST_DEPTHS * float(np.median(seen))) if seen else extent


def near_depth(views: Sequence[CaptureView], points: NDArray[np.floating]) -> float:
    """Smallest depth that is drawn in training, world units.

    Args:
        points: (P, 3) of the scene; P may be 0.
    """
    poses, cameras = [view.world_to_camera for view in views], [view.camera for view in views]
    return NEAR * unit_of_length(poses, cameras, points)


def _typical_depth(pose: NDArray[np.float64], camera: PinholeCamera, points: NDArray[np.floating]) -> float:
    """The median depth of the points in the picture, world units; 0 where there are none."""
    sampled = points[:: max(len(points) // _SAMPLED, 1)]
    x, y, depth = (sampled @ pose[:3, :3].T + pose[:3, 3]).T
    across, down = camera.fx * x + camera.cx * depth, camera.fy * y + camera.cy * depth
    within = (across > 0) & (across < camera.width * depth) & (down > 0) & (down < camera.height * depth)
    return float(np.median(depth[within])) if within.any() else 0.0


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
