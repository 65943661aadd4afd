"""Photographs and enhancers that leave nothing to measure: finite numbers only, and the reason in the report."""

from __future__ import annotations

import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.demo import SHOWROOM
from cvdgs.core.files.images import read_png, write_png
from cvdgs.core.pipeline import run as pipeline
from cvdgs.core.runs.report import write_report
from cvdgs.core.runs.report_page import write_report_page
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer, Settings
from cvdgs.core.splats.io.ply import read_ply

SIZE = (36, 48)
VIEWS = 12


class NotFinite:
    """A plug-in that divides by nothing in some places."""

    def fit(self, images, reporter=None, *, alphas=None) -> None:
        pass

    def __call__(self, image: np.ndarray) -> np.ndarray:
        enhanced = np.asarray(image, np.float32) / 255.0
        enhanced[::3, ::3], enhanced[1, 1] = np.nan, np.inf
        return enhanced


def one_colour(number: int) -> np.ndarray:
    return np.full((*SIZE, 3), 120, np.uint8)


def a_slope(number: int) -> np.ndarray:
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    return np.stack([100 + rows, 120 + columns, 110 + rows], -1).astype(np.uint8)


def patches(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 256, (9, 12, 3)).repeat(4, 0).repeat(4, 1).astype(np.uint8)


def capture(folder: Path, picture: Callable[[int], np.ndarray]) -> Path:
    """The demo's first cameras with other photographs."""
    transforms = json.loads((SHOWROOM / "transforms.json").read_text())
    transforms["frames"] = transforms["frames"][:VIEWS]
    (folder / "images").mkdir(parents=True)
    for number, frame in enumerate(transforms["frames"]):
        frame["file_path"] = f"images/{number:03d}.png"
        write_png(folder / frame["file_path"], picture(number))
    factor = SIZE[1] / transforms["w"]
    transforms |= {name: transforms[name] * factor for name in ("fl_x", "fl_y", "cx", "cy") if name in transforms}
    transforms |= {"w": SIZE[1], "h": SIZE[0]}
    (folder / "transforms.json").write_text(json.dumps(transforms))
    shutil.copy(SHOWROOM / "points.ply", folder / "points.ply")
    return folder


def report_of(tmp_path: Path, picture: Callable[[int], np.ndarray], severity: float = 1.0) -> dict:
    out = tmp_path / "out"
    out.mkdir()
    settings = Settings(
        capture=str(capture(tmp_path / "capture", picture)),
        out=str(out),
        iterations=20,
        gaussians=300,
        enhancer="lut",
        layers=[Layer("deutan", severity)],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        report = pipeline.run(settings, out, Reporter())
    report["seconds"]["total"] = 1.0
    write_report(out, report)  # refuses what is not finite
    write_report_page(out)
    for path in out.glob("*.ply"):
        assert all(np.isfinite(values).all() for values in vars(read_ply(path)).values())
    return report


@pytest.mark.parametrize("picture", [one_colour, a_slope])
def test_photographs_without_contrast_have_no_figures_of_it_and_the_report_says_why(tmp_path, picture):
    report = report_of(tmp_path, picture)
    assert report["layers"]["deutan-1.0"]["ccpr"]["rendered"] is None
    assert "differ by" in report["notes"]["contrast"]
    assert report["reconstruction"]["psnr"] > 10.0


def test_normal_vision_keeps_all_contrast(tmp_path):
    report = report_of(tmp_path, patches, severity=0.0)
    assert report["layers"]["deutan-0.0"]["ccpr"]["enhanced"] == 1.0
    assert "contrast" not in report["notes"]


def test_pixels_without_a_finite_colour_stay_as_photographed(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "_make_enhancers", lambda settings: {layer: NotFinite() for layer in settings.layers})
    report = report_of(tmp_path, patches)
    (warning,) = (found for found in report["warnings"] if found["name"] == "enhancer-not-finite")
    assert f"{VIEWS * (12 * 16 + 1):,} pixels" in warning["message"]
    enhanced = sorted((tmp_path / "out" / "enhanced" / "deutan-1.0").glob("*.png"))
    assert len(enhanced) == VIEWS
    for number, path in enumerate(enhanced):
        np.testing.assert_array_equal(read_png(path), patches(number))
