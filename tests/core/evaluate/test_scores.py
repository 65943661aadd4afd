"""One scorer gives the same figures to runs, photographs and benchmarks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from cvdgs.core.color.metrics import contrast_scores, naturalness, psnr, ssim
from cvdgs.core.color.simulation import Observer, simulate
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.evaluate.scores import SIMULATED_FIGURES, Scorer, average, score_layer
from cvdgs.core.photographs.scores import figures_of

OBSERVER = Observer("deutan", 0.8)


def picture(seed: int) -> np.ndarray:
    """Patches in random colours."""
    return np.random.default_rng(seed).integers(0, 256, (6, 8, 3)).repeat(8, 0).repeat(8, 1).astype(np.uint8)


@pytest.fixture
def mask() -> np.ndarray:
    covered = np.ones((48, 64), bool)
    covered[:, :20] = False
    return covered


def test_figures_are_those_of_the_metrics_over_the_covered_pixels(mask):
    original, version = picture(0), picture(1)
    scorer, covered = Scorer(original, OBSERVER, mask), torch.from_numpy(mask)
    before, after = image_to_tensor(original), image_to_tensor(version)
    seen = simulate(after, "deutan", 0.8)
    expected = contrast_scores(before, seen, mask=covered)
    found = scorer.simulated(version)
    assert {name: found[name] for name in ("ccpr", "pairs", "ccpr_mean", "ccpr_global", "ccfr")} == {
        name: getattr(expected, name) for name in ("ccpr", "pairs", "ccpr_mean", "ccpr_global", "ccfr")
    }
    assert found["ssim_simulated"] == ssim(before, seen, mask=covered)
    assert scorer.ccpr(version) == expected.ccpr
    assert scorer.naturalness(version) == naturalness(before, after, mask=covered)
    assert scorer.psnr_between(original, version) == psnr(before, after, mask=covered)


def test_a_layer_and_a_photograph_of_the_same_pictures_have_the_same_figures(mask):
    original, enhanced, rendered = picture(0), picture(1), picture(2)
    layer = score_layer(Scorer(original, OBSERVER, mask), original, enhanced, rendered, original)
    photograph, scale = figures_of(original, enhanced, mask.astype(np.uint8), OBSERVER)
    assert scale == 1.0
    for figure in SIMULATED_FIGURES:
        assert layer[figure]["unenhanced"] == layer[figure]["input"]
        for kind in ("input", "enhanced"):
            assert layer[figure][kind] == photograph[f"{figure}_{kind}"]
    assert layer["naturalness"]["delta_e"] == photograph["naturalness_delta_e_2000"]


def test_protected_colours_are_counted_in_the_photograph_where_it_is_covered(mask):
    original = np.full((48, 64, 3), 120, np.uint8)
    darker = original - 30
    found = Scorer(original, OBSERVER, mask).protected(darker)
    assert found["grey_pixels"] == mask.sum()
    assert found["grey_delta_e"] == pytest.approx(naturalness(*map(image_to_tensor, (original, darker))).delta_e_2000)
    assert found["white_pixels"] == 0
    assert math.isnan(found["white_delta_e"])


def test_views_without_a_figure_are_left_out_of_its_mean():
    views = [{"psnr": value, "ccpr": {"input": value}} for value in (30.0, math.nan, 20.0)]
    assert average(views) == {"psnr": 25.0, "ccpr": {"input": 25.0, "tau": 6}}
    assert math.isnan(average(views[1:2])["psnr"])


def test_a_second_photograph_is_scored_like_the_other_pictures_of_its_layer():
    original, enhanced = picture(0), picture(1)
    again = {"again": picture(2), "again_enhanced": picture(3)}
    scorer = Scorer(original, OBSERVER)
    with_it = score_layer(scorer, original, enhanced, enhanced, original, again)
    without = score_layer(scorer, original, enhanced, enhanced, original)
    assert with_it["ccpr"]["again_enhanced"] == scorer.ccpr(again["again_enhanced"])
    assert "again" not in without["ccpr"]
    assert average([without, with_it])["ccpr"]["again"] == with_it["ccpr"]["again"]


def test_contrast_at_half_size_is_that_of_pictures_of_half_the_size(mask):
    original, version = picture(0), picture(1)  # patches of 8 pixels, which 2x2 averages leave as they are
    found = Scorer(original, OBSERVER, mask).simulated(version)
    small = Scorer(original[::2, ::2], OBSERVER, mask[::2, ::2]).simulated(version[::2, ::2])
    assert found["ccpr_half"] == pytest.approx(small["ccpr"], abs=1e-12)
    assert found["ccfr_quarter"] == pytest.approx(small["ccfr_half"], abs=1e-12)


def test_pictures_too_small_for_a_pyramid_have_no_figure_there():
    tiny = picture(0)[:6, :6]
    found = Scorer(tiny, OBSERVER).simulated(tiny)
    assert math.isnan(found["ccpr_quarter"])
