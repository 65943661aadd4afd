"""Small layered scenes with cameras for the tests of the web page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cvdgs.core.capture.folder import CaptureView
from cvdgs.core.capture.model import PinholeCamera
from cvdgs.core.files.images import write_png
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.io.ply import write_ply
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


FIGURES = dict.fromkeys(("input", "enhanced", "unenhanced", "rendered"), 0.7)
LAYER = {
    "psnr_to_enhanced": 31.5,
    "ccpr": {**FIGURES, "input": 0.6, "rendered": 0.8, "tau": 6},
    "ccpr_mean": FIGURES,
    "ssim_simulated": FIGURES,
    "naturalness": {"ssim": 0.9, "psnr": 22.0, "delta_e": 6.1},
    "rwe": {"ratio": 1.0, "enhanced_ratio": 1.0},
}


def write_run(folder: Path, *, with_layers: bool = True, simulation: str = "machado") -> Path:
    """A finished run of `layered` and `ring`, with a picture of the second view in every layer."""
    layers = layered(400) if with_layers else {"original": layered(400)["original"]}
    picture = np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8)
    for layer, (name, gaussians) in enumerate(layers.items()):
        write_ply(folder / ("splats.ply" if name == "original" else f"splats.{name}.ply"), gaussians)
        for number, place in enumerate(("", "simulated", "simulated_input")):
            write_png(folder / "renders" / name / place / "view1.png", picture + np.uint8(3 * layer + number))
    write_png(folder / "capture" / "images" / "view1.png", picture // 2)
    common = {
        "w": CAMERA.width,
        "h": CAMERA.height,
        "fl_x": CAMERA.fx,
        "fl_y": CAMERA.fy,
        "cx": CAMERA.cx,
        "cy": CAMERA.cy,
    }
    frames = [
        {"file_path": f"images/{view.key}.png", **common, "transform_matrix": view.camera_to_world.tolist()}
        for view in ring()
    ]
    (folder / "capture" / "transforms.json").write_text(json.dumps({"camera_model": "PINHOLE", "frames": frames}))
    report = {
        "schema": "cvdgs-report-1",
        "versions": {"cvdgs": "7"},
        "device": "cpu",
        "settings": {"capture": "photos/blobs & more", "simulation": simulation, "layers": []},
        "capture": {"format": "colmap", "views": 4, "train": 3, "test": 1, "width": 160, "height": 120, "points": 5},
        "gaussians": 400,
        "seconds": {"total": 22.0},
        "peak_memory_mb": 800,
        "reconstruction": {"psnr": 30.0, "ssim": 0.9},
        "layers": {name: LAYER for name in layers if name != "original"},
        "views_shown": ["view1"],
        "curve": [],
        "notes": {},
        "warnings": [],
    }
    (folder / "report.json").write_text(json.dumps(report))
    return folder
