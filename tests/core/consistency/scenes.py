"""Analytic scenes: textured planes rendered by ray casting, with exact depth and coverage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.consistency import Correspondences, CorrespondenceSettings, SceneCorrespondences


@dataclass(frozen=True)
class Posed:
    """A camera with a pose: all that correspondences need of a view."""

    camera: PinholeCamera
    world_to_camera: np.ndarray


@dataclass(frozen=True)
class Plane:
    """normal · x = offset, cut to |x| < half_width, coloured by a function of the world position."""

    normal: tuple[float, float, float]
    offset: float
    half_width: float = np.inf
    tint: float = 0.0

    def color(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) smooth texture in [0, 1]."""
        x, y, z = np.moveaxis(points, -1, 0)
        waves = np.stack([np.sin(3 * x + y), np.sin(2 * y - z + 1), np.cos(2 * x - 3 * y)], -1)
        return 0.5 + 0.25 * waves + self.tint


def look_at(eye: Sequence[float], target: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(4, 4) world-to-camera with OpenCV axes; world y points down."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ np.asarray(eye, float)
    return matrix


def camera_at(eye: Sequence[float], width: int = 96, height: int = 72) -> Posed:
    """A camera at `eye` that looks at the origin; fx differs from fy and the principal point is off centre."""
    return Posed(PinholeCamera(width, height, 90.0, 84.0, width / 2 + 3.0, height / 2 - 2.0), look_at(eye))


def rays(view: Posed) -> tuple[np.ndarray, np.ndarray]:
    """(3,) centre and (H, W, 3) world directions whose camera z is 1."""
    camera = view.camera
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(columns.shape)], -1)
    rotation, translation = view.world_to_camera[:3, :3], view.world_to_camera[:3, 3]
    return -rotation.T @ translation, local @ rotation


def render(view: Posed, planes: Sequence[Plane]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(H, W, 3) colour, (H, W) depth, (H, W) alpha and (H, W) number of the plane seen, -1 for none."""
    center, directions = rays(view)
    depth = np.full(directions.shape[:2], np.inf)
    color, seen = np.zeros(directions.shape), np.full(directions.shape[:2], -1)
    for number, plane in enumerate(planes):
        distance = (plane.offset - center @ np.array(plane.normal)) / (directions @ np.array(plane.normal))
        points = center + distance[..., None] * directions
        nearer = (distance > 0) & (distance < depth) & (np.abs(points[..., 0]) < plane.half_width)
        depth[nearer], color[nearer], seen[nearer] = distance[nearer], plane.color(points)[nearer], number
    return color, np.where(seen >= 0, depth, 0.0), (seen >= 0).astype(float), seen


def world_points(view: Posed, depth: np.ndarray) -> np.ndarray:
    """(H, W, 3) surface points."""
    center, directions = rays(view)
    return center + depth[..., None] * directions


def project(view: Posed, points: np.ndarray) -> np.ndarray:
    """(M, 2) pixel positions by the definition of the pinhole camera."""
    local = points @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
    camera = view.camera
    return np.stack(
        [camera.fx * local[:, 0] / local[:, 2] + camera.cx, camera.fy * local[:, 1] / local[:, 2] + camera.cy], -1
    )


def render_all(views: Sequence[Posed], planes: Sequence[Plane]) -> tuple[list[np.ndarray], ...]:
    """Lists of colours, depths, alphas and plane numbers."""
    rendered = [render(view, planes) for view in views]
    return tuple(list(channel) for channel in zip(*rendered, strict=True))


def match(
    depths: Sequence[np.ndarray],
    alphas: Sequence[np.ndarray],
    views: Sequence[Posed],
    pairs: Sequence[tuple[int, int]],
    settings: CorrespondenceSettings | None = None,
) -> list[Correspondences]:
    """Correspondences of each pair of views."""
    settings = settings or CorrespondenceSettings()
    return SceneCorrespondences(views, lambda i: (depths[i], alphas[i]), settings).of_pairs(pairs)
