"""What a run's photographs, course and figures are worth warning of."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.evaluate import advice
from cvdgs.core.evaluate.advice import advise, note_exposure
from cvdgs.core.evaluate.evaluation import Split
from cvdgs.core.files.images import write_png
from cvdgs.scripts.benchmarks.stress.perturbations import compressed, dimly_lit, motion_blurred

GOOD_LAYER = {
    "ccpr": {"input": 0.65, "enhanced": 0.9, "rendered": 0.76},
    "rwe": {"ratio": 0.86, "enhanced_ratio": 1.18},
}
GOOD_CURVE = ({"step": 100, "psnr": 30.0},)


def figures(name: str = "deutan-1.0", psnr: float = 30.0, **changed: dict[str, float]) -> dict[str, Any]:
    layer = {key: {**values, **changed.get(key, {})} for key, values in GOOD_LAYER.items()}
    return {"reconstruction": {"psnr": psnr}, "layers": {name: layer}}


@pytest.fixture(scope="module")
def showroom() -> Capture:
    capture = read_capture(SHOWROOM, max_size=240)
    return replace(capture, views=capture.views[::8])


SPLIT = Split([1, 2, 3, 4], [0])


def names(capture: Capture, folder: Path, curve: Any = GOOD_CURVE, found: dict[str, Any] | None = None) -> set[str]:
    return {warning.name for warning in advise(capture, SPLIT, folder, curve, found or figures())}


def test_a_good_run_is_left_in_peace(showroom: Capture, tmp_path: Path) -> None:
    write_png(tmp_path / "renders" / "original" / f"{showroom.views[0].key}.png", showroom.views[0].image)
    assert names(showroom, tmp_path) == set()


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("poor-reconstruction", figures(psnr=17.0)),
        ("enhancer-contradicts-itself", figures(rwe={"enhanced_ratio": 1.8})),
        ("views-disagree", figures(rwe={"ratio": 1.2})),
        ("colours-not-separated", figures(ccpr={"enhanced": 0.7})),
        ("contrast-lost", figures(ccpr={"rendered": 0.3})),
        ("nothing-to-enhance", figures("deutan-0.0", ccpr={"rendered": 0.3})),
    ],
)
def test_bad_figures_are_named_and_nothing_else(
    showroom: Capture, tmp_path: Path, name: str, found: dict[str, Any]
) -> None:
    assert names(showroom, tmp_path, found=found) == {name}


def test_a_scene_has_to_keep_the_contrast_of_the_photographs_and_not_that_which_enhancement_added(
    showroom: Capture, tmp_path: Path
) -> None:
    assert names(showroom, tmp_path, found=figures(ccpr={"input": 0.6, "enhanced": 0.95, "rendered": 0.5})) == set()


def test_figures_that_could_not_be_measured_are_no_reason_to_warn(showroom: Capture, tmp_path: Path) -> None:
    missing = figures(
        psnr=float("nan"), rwe={"ratio": float("nan"), "enhanced_ratio": float("nan")}, ccpr={"rendered": float("nan")}
    )
    assert names(showroom, tmp_path, curve=({"step": 1, "psnr": None},), found=missing) == set()


def test_exposures_that_cost_held_out_views_are_told(showroom: Capture, tmp_path: Path) -> None:
    curve = [{"psnr": 20.0}, {"psnr": 24.0, "psnr_any_exposure": 27.5}]
    (warning,) = advise(showroom, SPLIT, tmp_path, curve, figures())
    assert warning.name == "exposure-varies"
    assert "3.5 dB" in warning.message
    assert names(showroom, tmp_path, curve=[{"psnr": 27.0, "psnr_any_exposure": 27.5}]) == set()


def test_a_note_tells_what_psnr_counts_against_a_scene_whose_exposures_were_corrected() -> None:
    assert (
        "24.0 dB as they were exposed, and 24.6 dB"
        in note_exposure([{"psnr": 20.0}, {"psnr": 24.0, "psnr_any_exposure": 24.6}])["exposure"]
    )
    assert note_exposure([{"psnr": 24.0}]) == note_exposure([]) == {}


@pytest.mark.parametrize(("pixels", "expected"), [(0.0, set()), (0.2, set()), (2.0, {"cameras-off"})])
def test_photographs_that_lie_beside_the_scene_say_that_cameras_are_off(
    showroom: Capture, tmp_path: Path, pixels: float, expected: set[str]
) -> None:
    view = showroom.views[0]
    moved = np.round(shift(view.image.astype(float), (0.0, pixels, 0.0), order=1, mode="nearest")).astype(np.uint8)
    write_png(tmp_path / "renders" / "original" / f"{view.key}.png", moved)
    assert names(showroom, tmp_path) == expected


def test_a_blurry_scene_does_not_say_that_cameras_are_off(showroom: Capture, tmp_path: Path) -> None:
    view = showroom.views[0]
    blurred = gaussian_filter(view.image.astype(float), (2.5, 2.5, 0)).astype(np.uint8)
    write_png(tmp_path / "renders" / "original" / f"{view.key}.png", blurred)
    assert names(showroom, tmp_path) == set()


@pytest.mark.parametrize("part", ["mask", "alpha"])
def test_a_photograph_of_which_a_part_is_not_looked_at_says_nothing_of_cameras(
    showroom: Capture, tmp_path: Path, part: str
) -> None:
    """Its rendering shows something else there."""
    view = showroom.views[0]
    shown = np.ones(view.image.shape[:2], bool)
    shown[:, :80] = False
    partly = replace(view, **{part: shown if part == "mask" else np.where(shown, 255, 0).astype(np.uint8)})
    moved = np.roll(view.image, 2, axis=1)
    write_png(tmp_path / "renders" / "original" / f"{view.key}.png", moved)
    assert names(showroom, tmp_path) == {"cameras-off"}
    assert names(replace(showroom, views=(partly, *showroom.views[1:])), tmp_path) == set()


def test_photographs_without_light_sharpness_or_quality_are_told(showroom: Capture, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    assert names(dimly_lit(showroom, 6, rng), tmp_path) == {"noisy-photographs"}
    assert names(motion_blurred(showroom, 0.03, rng), tmp_path) == {"blurred-photographs"}
    assert names(compressed(showroom, 12), tmp_path) == {"jpeg-blocks"}
    dark = replace(showroom, views=tuple(replace(view, image=view.image // 10) for view in showroom.views))
    assert "dark-photographs" in names(dark, tmp_path)


def test_photographs_of_one_colour_are_no_reason_to_warn(tmp_path: Path) -> None:
    camera = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)
    grey = np.full((48, 64, 3), 128, np.uint8)
    views = tuple(View(f"view_{i}", Path(f"{i}.png"), camera, np.eye(4), grey) for i in range(5))
    points = np.zeros((0, 3), np.float32)
    capture = Capture(Path("grey"), "transforms", views, points, points.astype(np.uint8))
    assert names(capture, tmp_path) == set()


def test_every_warning_is_explained() -> None:
    rooms = [ROOT / "core" / name for name in ("capture", "photographs", "pipeline")]
    sources = [Path(advice.__file__), *(path for room in rooms for path in room.glob("*.py"))]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    given = set(re.findall(r'(?:CaptureWarning|\.warn|\.warning)\(\s*"([a-z-]+)"', text))
    explained = (ROOT / "docs" / "warnings.md").read_text(encoding="utf-8")
    assert len(given) > 20
    assert not [name for name in given if f"`{name}`" not in explained]
