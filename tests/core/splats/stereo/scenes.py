"""Photographs of a wall, drawn exactly: what dense stereo has to find is known."""

from pathlib import Path

import numpy as np

from cvdgs.core.capture.model import PinholeCamera, View

DISTANCE = 4.0  # of the wall z = 0 from the cameras
SIZE = (96, 72)


def texture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Colours in [0, 1] of the places (x, y) on the wall: waves of many lengths and directions."""
    rng = np.random.default_rng(3)
    waves = [
        np.sin(a * x + b * y + c)
        for a, b, c in zip(rng.uniform(-14, 14, 12), rng.uniform(-14, 14, 12), rng.uniform(0, 6, 12), strict=True)
    ]
    channels = [0.5 + sum(waves[i::3]) / 10.0 for i in range(3)]
    return np.clip(np.stack(channels, axis=-1), 0.0, 1.0)


def plain(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """One colour everywhere."""
    return np.full((*x.shape, 3), 0.6)


def camera_at(x: float, y: float, towards: float = 0.0) -> np.ndarray:
    """(4, 4) world to camera, from (x, y, -DISTANCE), which looks at (towards, 0, 0)."""
    position = np.array([x, y, -DISTANCE])
    forward = np.array([towards, 0.0, 0.0]) - position
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ position
    return pose


def wall_view(pose: np.ndarray, colors=texture, size: tuple[int, int] = SIZE, disc: float | None = None) -> View:
    """The wall z = 0 from a pose; with `disc`, a cut-out of the disc of that radius on it, in front of odd colours."""
    width, height = size
    camera = PinholeCamera(width, height, width * 0.9, width * 0.9, width / 2, height / 2)
    fine = 3  # samples a pixel in each direction
    y, x = (np.mgrid[: height * fine, : width * fine] + 0.5) / fine
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1) @ pose[:3, :3]
    center = -pose[:3, :3].T @ pose[:3, 3]
    places = center + rays * (-center[2] / rays[..., 2])[..., None]
    image = colors(places[..., 0], places[..., 1])
    alpha = None
    if disc is not None:
        inside = np.hypot(places[..., 0], places[..., 1]) < disc
        noise = np.random.default_rng(int(1e3 * abs(pose[0, 3])) + 1).uniform(0, 1, image.shape)
        image = np.where(inside[..., None], image, noise)
        alpha = np.round(255 * inside.reshape(height, fine, width, fine).mean(axis=(1, 3))).astype(np.uint8)
    image = image.reshape(height, fine, width, fine, 3).mean(axis=(1, 3))
    return View(f"{pose[0, 3]:.3f}", Path("x.png"), camera, pose, np.round(255 * image).astype(np.uint8), alpha)


def views_of_wall(count: int = 7, **options) -> list[View]:
    """Views on a zigzag before the wall, which look at its middle."""
    steps = np.arange(count) - (count - 1) / 2
    return [wall_view(camera_at(0.45 * step, 0.3 * (-1) ** i), **options) for i, step in enumerate(steps)]
