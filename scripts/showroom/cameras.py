"""Where the photographs are taken from: exact pinhole cameras on two rings, or on a walk. numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .settings import CameraSettings

SENSOR_WIDTH = 36.0
"""Millimetres; `CameraSettings.focal_length` refers to it."""


@dataclass(frozen=True)
class Pose:
    """One camera.

    Attributes:
        name: of its image file, without extension.
        camera_to_world: (4, 4), OpenGL axes: x right, y up, z backwards.
    """

    name: str
    camera_to_world: NDArray[np.float64]


def focal_pixels(settings: CameraSettings) -> float:
    """The focal length in pixels; pixels are square and the sensor's width fills the image's."""
    return settings.focal_length / SENSOR_WIDTH * settings.width


def rings(settings: CameraSettings) -> list[Pose]:
    """The cameras of both rings in turns, from left to right; the upper ring is half a step ahead of the lower one."""
    azimuths = np.linspace(-settings.half_arc, settings.half_arc, settings.views)
    poses = []
    for index, azimuth in enumerate(np.deg2rad(azimuths)):
        radius, height = settings.ring_radii[index % 2], settings.ring_heights[index % 2]
        x, y, _ = settings.target
        eye = np.array([x + radius * np.sin(azimuth), y - radius * np.cos(azimuth), height])
        poses.append(Pose(f"view_{index:03d}", look_at(eye, np.array(settings.target))))
    return poses


_ROUNDS = ((1.75, 1.05, 1.0), (2.75, 1.75, -1.0))
"""Half the length and the width of an ellipse on which one walks round the room, and whether one looks away from the
middle (1) or across it (-1)."""
_EYE, _BOB = 1.5, 0.08  # metres over the floor, and how far the hand goes up and down
_SWAY = 22.0  # degrees, to both sides


def walk(settings: CameraSettings) -> list[Pose]:
    """Twice round the room, first looking at the walls nearby, then across it, while the view sways to both sides."""
    poses: list[Pose] = []
    for number, (length, width, outward) in enumerate(_ROUNDS):
        count = (settings.views + 1 - number) // 2
        for step in range(count):
            angle = 2 * np.pi * (step + 0.5 * number) / count
            eye = np.array([length * np.cos(angle), width * np.sin(angle), _EYE + _BOB * np.sin(5 * angle)])
            heading = np.arctan2(outward * eye[1] / width, outward * eye[0] / length)
            heading += np.deg2rad(_SWAY) * np.sin(7 * angle)
            ahead = np.array([np.cos(heading), np.sin(heading), -0.16 + 0.1 * np.cos(3 * angle)])
            poses.append(Pose(f"view_{len(poses):03d}", look_at(eye, eye + ahead)))
    return poses


def look_at(eye: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Camera-to-world (4, 4), OpenGL axes, of an upright camera at `eye` that sees `target` in its centre."""
    backwards = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], backwards)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :4] = np.stack([right, np.cross(backwards, right), backwards, eye], axis=1)
    return pose


def pixel_directions(settings: CameraSettings, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """Directions (N, 3) in the camera's OpenGL axes of (N, 2) pixel positions (x, y), scaled to planar depth 1."""
    offset = (np.asarray(pixels, np.float64) - [settings.width / 2, settings.height / 2]) / focal_pixels(settings)
    return np.stack([offset[:, 0], -offset[:, 1], -np.ones(len(offset))], axis=-1)


def pixel_centres(settings: CameraSettings) -> NDArray[np.float64]:
    """(H * W, 2) positions (x, y) of all pixel centres, row by row from the top left."""
    y, x = np.mgrid[: settings.height, : settings.width] + 0.5
    return np.stack([x.ravel(), y.ravel()], axis=-1)
