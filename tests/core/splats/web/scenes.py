"""Small layered scenes with cameras for the tests of the web page."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cvdgs.core.capture.folder import CaptureView
from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.web.page import Surroundings

CAMERA = PinholeCamera(160, 120, 150.0, 140.0, 84.0, 57.0)
"""With fx != fy and an off-centre principal point."""


def layered(count: int, degree: int = 0) -> dict[str, Gaussians]:
    """Coloured blobs in a cube of side two, and the same in the colours of two layers."""
    random = np.random.default_rng(count)
    sh = random.normal(0.0, 0.15, (count, (degree + 1) ** 2, 3))
    sh[:, 0] = (random.uniform(0.0, 1.0, (count, 3)) - 0.5) / SH_C0
    first = Gaussians(
        means=random.uniform(-1.0, 1.0, (count, 3)).astype(np.float32),
        log_scales=np.log(0.15 * random.uniform(0.05, 1.0, (count, 3))).astype(np.float32),
        quaternions=random.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=random.uniform(-3.0, 6.0, count).astype(np.float32),
        sh=sh.astype(np.float32),
    )
    colors = np.clip(0.5 + SH_C0 * sh[:, 0], 0.0, 1.0)
    return {
        "original": first,
        "deutan-1.0": first.with_base_colors((1.0 - colors).astype(np.float32)),
        "tritan-0.5": first.with_base_colors(colors[:, ::-1].astype(np.float32)),
    }


def ring(count: int = 4, height: float = 0.8) -> list[CaptureView]:
    """Cameras around the cube that look at its middle, +Z up."""
    angles = 2.0 * np.pi * np.arange(count) / count
    eyes = [np.array([3.2 * np.cos(angle), 3.2 * np.sin(angle), height]) for angle in angles]
    return [CaptureView(f"view{n}", CAMERA, look_at(eye)) for n, eye in enumerate(eyes)]


def look_at(eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) OpenGL camera to world."""
    back = eye / np.linalg.norm(eye)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return pose


def surroundings(**others) -> Surroundings:
    """Of a page that begins in the second view of `ring`."""
    captions = {"deutan-1.0": "A deutan could tell apart 60 of 100, then 80.", "tritan-0.5": "A tritan gains too."}
    known = {"title": "Blobs", "captions": captions, "names": {"deutan-1.0": "deutan vision"}, "views": ring()}
    return Surroundings(**{**known, "start": "view1", **others})
