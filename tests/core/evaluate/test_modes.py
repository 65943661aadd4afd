"""The modes are compared on the same correspondences, and an enhancer that drifts tells them apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture import Capture
from cvdgs.core.enhance.enhancer import IdentityEnhancer
from cvdgs.core.enhance.lut import as_float
from cvdgs.core.evaluate.modes import ModeFigures, PerViewLut, compare_modes, write_modes
from cvdgs.core.events import Reporter
from cvdgs.core.settings import Settings

from ..splats.test_trainer import photographs, wall


class Drifting(IdentityEnhancer):
    """Every image gets brighter or darker, by its own pixels: as strong a drift as the seed reports."""

    def __call__(self, image):
        values = as_float(image)
        return np.clip(values + (0.1 if int(np.asarray(image, np.int64).sum()) % 2 else -0.1), 0.0, 1.0)


@pytest.fixture(scope="module")
def rows(tmp_path_factory) -> dict[str, ModeFigures]:
    scene = wall(300)
    views = tuple(replace(view, source=Path("wall")) for view in photographs(scene, 8))
    capture = Capture(Path("wall"), "test", views, scene.means, np.full((300, 3), 128, np.uint8))
    settings = Settings(capture="wall", out="out", iterations=120, gaussians=500, holdout=5)
    folder = tmp_path_factory.mktemp("modes")
    found = compare_modes(capture, settings, Drifting(), "drifting", folder, Reporter())
    write_modes(folder, found)
    assert "| wall | drifting | joint |" in (folder / "modes.md").read_text()
    assert (folder / "modes.csv").read_text().count("\n") == 4
    return {row.mode: row for row in found}


def test_what_is_enhanced_afterwards_drifts_and_what_is_fitted_to_all_views_does_not(rows):
    assert rows["post"].rwe_to_post == 1.0
    assert rows["post"].rwe_absolute > 0.05
    assert rows["layers"].rwe_to_post < 0.38
    assert rows["joint"].rwe_to_post < 0.38
    assert rows["layers"].added_to_post < rows["layers"].rwe_to_post


def test_the_modes_are_measured_on_the_same_photographs_and_points(rows):
    for name in ("ccpr_input", "ccpr_enhanced", "rwe_enhanced", "rwe_unenhanced"):
        assert len({getattr(row, name) for row in rows.values()}) == 1
    assert rows["layers"].gaussians == rows["post"].gaussians
    assert rows["layers"].geometry_seconds == rows["post"].geometry_seconds


def test_a_lut_of_its_own_gives_one_colour_another_result_in_another_image():
    rng = np.random.default_rng(0)
    red_and_green = np.where(rng.random((24, 24, 1)) < 0.5, [180, 60, 50], [90, 110, 40]).astype(np.uint8)
    other = red_and_green.copy()
    other[0, 0] = red_and_green[0, 0] + np.array([1, 0, 0], np.uint8)  # the coin falls on its other side
    enhancer = PerViewLut("deutan", 1.0, "machado")
    enhancer.fit([red_and_green])
    first, second = enhancer(red_and_green), enhancer(other)
    assert np.abs(first - second)[1:].mean() > 0.01
