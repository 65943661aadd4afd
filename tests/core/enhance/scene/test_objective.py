"""The objective's terms are what they say: judged by a plain float64 computation, pair by pair, and by kornia."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from colour.difference import delta_E_CIE1994
from kornia.metrics import ssim

from cvdgs.core.color.metrics import ccpr
from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.spaces import delta_e_2000, srgb_to_lab
from cvdgs.core.enhance.scene.objective import Objective, ObjectiveWeights, lost_contrast

OBSERVER = Observer("deutan", 1.0)
SHAPE = (21, 30)


def picture(seed: int, shape: tuple[int, int] = SHAPE) -> torch.Tensor:
    """(3, H, W) patches of colour with some noise, so that some neighbours are distinct and others are not."""
    generator = np.random.default_rng(seed)
    patches = generator.random((3, -(-shape[0] // 4), -(-shape[1] // 4))).repeat(4, 1).repeat(4, 2)
    noisy = patches[:, : shape[0], : shape[1]] + generator.normal(0.0, 0.02, (3, *shape))
    return torch.from_numpy(noisy.clip(0.0, 1.0))


def coverage() -> torch.Tensor:
    covered = torch.ones(SHAPE, dtype=torch.float64)
    covered[5:8] = 0.5
    covered[:, :9] = 0.0
    return covered


def reduced(image: np.ndarray) -> np.ndarray:
    """(..., H, W) at a quarter of its size."""
    height, width = (side // 4 * 4 for side in image.shape[-2:])
    blocks = image[..., :height, :width].reshape(*image.shape[:-2], height // 4, 4, width // 4, 4)
    return blocks.mean((-3, -1))


def seen(image: torch.Tensor) -> np.ndarray:
    return srgb_to_lab(OBSERVER.simulate(image)).numpy()


def pairs(before: np.ndarray, after: np.ndarray, covered: np.ndarray, offsets: list[tuple[int, int]]) -> np.ndarray:
    """(P, 3) d, d' and weight of every pair of (3, H, W) pictures at these offsets, one after the other."""
    rows = []
    height, width = covered.shape
    for down, right in offsets:
        for y in range(height - down):
            for x in range(max(-right, 0), min(width - right, width)):
                there = (y + down, x + right)
                d, d2 = (math.dist(lab[:, y, x], lab[(slice(None), *there)]) for lab in (before, after))
                rows.append((d, d2, covered[y, x] * covered[there]))
    return np.array(rows)


def lost(found: np.ndarray, few: float) -> float:
    d, d2, weight = found.T
    hinge = np.minimum(d, 8.0)
    share = np.where(d >= 6.0, np.maximum(hinge - d2, 0.0) / hinge, 0.0)
    return (weight * share).sum() / ((weight * (d >= 6.0)).sum() + few * weight.sum())


@pytest.fixture(scope="module", params=[False, True], ids=["opaque", "cut out"])
def case(request):
    image, shown = picture(1), 0.6 * picture(1) + 0.4 * picture(2)
    covered = coverage() if request.param else None
    objective = Objective(image, OBSERVER, covered, torch.Generator().manual_seed(0))
    weights = (torch.ones(SHAPE, dtype=torch.float64) if covered is None else covered).numpy()
    terms = {name: float(value) for name, value in objective.terms(shown).items()}
    return image, shown, weights, objective, terms


def test_neighbours_and_invented_contrast_are_those_of_all_pairs_of_adjacent_pixels(case):
    image, shown, weights, _, terms = case
    found = pairs(srgb_to_lab(image).numpy(), seen(shown), weights, [(0, 1), (1, 0), (1, 1), (1, -1)])
    assert terms["neighbours"] == pytest.approx(lost(found, 0.0005), rel=1e-9)
    d, d2, weight = found.T
    beyond = np.where(d < 6.0, np.maximum(d2 - np.maximum(d, 5.0), 0.0), 0.0)
    number = (weight * (d >= 6.0)).sum() + 0.0005 * weight.sum()
    assert terms["invented"] == pytest.approx((weight * beyond).sum() / number, rel=1e-9)
    assert terms["neighbours"] > 0.01
    assert terms["invented"] > 0.01


def test_areas_are_compared_on_the_picture_at_a_quarter_of_its_size(case):
    image, shown, weights, _, terms = case
    before, after = (torch.from_numpy(reduced(one.numpy())) for one in (image, shown))
    offsets = [(0, 1), (1, 0), (0, 3), (3, 0)]
    found = pairs(srgb_to_lab(before).numpy(), seen(after), reduced(weights), offsets)
    assert terms["areas"] == pytest.approx(lost(found, 0.0025), rel=1e-9)


def test_similarity_is_that_of_contrasts_a_fortieth_and_a_tenth_of_the_shorter_side_apart(case):
    image, shown, weights, _, terms = case
    expected = []
    for offset in [(0, 2), (2, 0), (0, 2), (2, 0)]:  # a tenth of 21 pixels is 2, and 2 is the least
        d, d2, weight = pairs(srgb_to_lab(image).numpy(), seen(shown), weights, [offset]).T
        d = np.minimum(d, 15.0)
        both, before = (np.average(one, weights=weight) for one in (np.minimum(d, d2), d))
        expected.append(1.0 - (both + 1.0) / (before + 1.0))
    assert terms["similarity"] == pytest.approx(np.mean(expected), rel=1e-9)


def test_the_terms_of_distant_pairs_vanish_for_those_who_see_all_and_not_for_those_who_lose_a_dimension(case):
    image, _, weights, _, terms = case
    nobody = Objective(image, Observer("deutan", 1e-9), torch.from_numpy(weights), torch.Generator().manual_seed(0))
    unchanged = nobody.terms(image)
    assert float(unchanged["distant"]) == pytest.approx(0.0, abs=1e-6)
    assert float(unchanged["apart"]) == pytest.approx(0.0, abs=1e-6)
    assert terms["distant"] > 0.01


def test_structure_is_kornia_s_ssim_of_the_original_and_of_what_is_seen(case):
    image, shown, weights, _, terms = case
    similarity = ssim(image[None], OBSERVER.simulate(shown)[None], 11, padding="valid")[0].mean(0).numpy()
    expected = np.average(1.0 - similarity, weights=weights[5:-5, 5:-5])
    assert terms["structure"] == pytest.approx(expected, rel=1e-6)


def test_the_change_is_cie94_where_it_is_large(case):
    image, shown, weights, _, terms = case
    before, after = (srgb_to_lab(one).numpy().transpose(1, 2, 0) for one in (image, shown))
    difference = delta_E_CIE1994(before, after)
    assert terms["change"] == pytest.approx(np.average(np.sqrt(difference**2 + 1.0) - 1.0, weights=weights), rel=1e-3)


def test_the_measured_change_is_the_mean_delta_e_2000_of_covered_pixels(case):
    image, shown, weights, objective, _ = case
    assert objective.change(shown) == pytest.approx(float(delta_e_2000(image, shown)[weights > 0.0].mean()))


def test_colours_outside_srgb_cost_by_how_far_they_are(case):
    _, shown, weights, objective, _ = case
    beyond = shown + 0.5
    outside = (beyond - beyond.clamp(0.0, 1.0)).square().mean(0).numpy()
    assert float(objective.terms(beyond)["gamut"]) == pytest.approx(np.average(outside, weights=weights))


def test_the_objective_is_the_weighted_sum_of_its_terms(case):
    _, shown, _, objective, terms = case
    weights = {**vars(ObjectiveWeights()), "change": 0.3}
    weights["structure"] *= 0.5
    expected = sum(weight * terms[name] for name, weight in weights.items())
    assert float(objective(shown, naturalness=0.3, structure=0.5)) == pytest.approx(expected)


def test_what_is_not_covered_counts_for_nothing():
    covered = coverage()
    image, shown = picture(1), picture(2)
    other, other_shown = image.clone(), shown.clone()
    other[:, :, :9], other_shown[:, :, :9] = 0.3, 0.9
    results = []
    for one, one_shown in ((image, shown), (other, other_shown)):
        terms = Objective(one, OBSERVER, covered, torch.Generator().manual_seed(0)).terms(one_shown)
        # Windows of SSIM reach five pixels beyond the covered ones; squares of four lie on both sides of column 9.
        results.append([float(value) for name, value in terms.items() if name not in ("structure", "areas")])
    assert results[0] == pytest.approx(results[1])


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (2, 3), (40, 1), (11, 5)])
def test_pictures_without_pairs_or_windows_have_finite_terms_and_slopes(shape):
    shown = picture(2, shape).requires_grad_()
    total = Objective(picture(1, shape), OBSERVER)(shown, naturalness=0.1)
    total.backward()
    assert torch.isfinite(total)
    assert torch.isfinite(shown.grad).all()


def test_a_picture_that_is_not_covered_steers_nothing():
    shown = picture(2).requires_grad_()
    total = Objective(picture(1), OBSERVER, torch.zeros_like(coverage()))(shown, naturalness=0.1)
    total.backward()
    assert float(total.detach()) == 0.0
    assert not shown.grad.any()


def test_lost_contrast_is_one_minus_ccpr_and_sees_that_a_plate_s_digit_is_gone():
    image = picture(1)
    fine, _ = lost_contrast(image, OBSERVER)
    assert fine == pytest.approx(1.0 - ccpr(image, OBSERVER.simulate(image))[0])
    generator = np.random.default_rng(0)
    lightness = generator.uniform(-0.15, 0.15, (96, 96)).repeat(2, 0).repeat(2, 1)  # of dots that hide the digit
    plate = np.full((3, 192, 192), 0.45) + lightness
    plate[0, 60:130, 60:130] += 0.1
    plate[1, 60:130, 60:130] -= 0.05
    fine, coarse = lost_contrast(torch.from_numpy(plate), OBSERVER)
    assert fine < 0.1
    assert coarse > 0.3
