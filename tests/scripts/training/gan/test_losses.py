"""The contrast loss sees lost contrast of any kind, and nothing where nothing is lost."""

from __future__ import annotations

import pytest
import torch

from cvdgs.core.color.metrics import ccpr
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import srgb_to_lab
from cvdgs.scripts.training.gan.losses import (
    CONTRAST_CAP,
    STABILISER,
    contrast_distance,
    discriminator_loss,
    generator_loss,
    structure_distance,
)

OFFSETS = (1, 5)


def isoluminant_stripes() -> torch.Tensor:
    """(1, 3, 32, 32) stripes that differ in a* alone."""
    lab = torch.zeros(1, 3, 32, 32)
    lab[:, 0], lab[:, 1, :, ::4], lab[:, 1, :, 1::4] = 60.0, 40.0, 40.0
    return lab


def test_what_is_seen_unchanged_costs_nothing():
    lab = srgb_to_lab(torch.rand(2, 3, 40, 40))
    assert contrast_distance(lab, lab, OFFSETS) == pytest.approx(0.0, abs=1e-6)


def test_flat_images_cost_nothing():
    lab = torch.full((1, 3, 32, 32), 50.0)
    assert contrast_distance(lab, lab + 7.0, OFFSETS) == pytest.approx(0.0, abs=1e-6)


def test_a_lost_isoluminant_edge_costs():
    lab = isoluminant_stripes()
    grey = lab * torch.tensor([1.0, 0.0, 0.0])[:, None, None]
    assert contrast_distance(lab, grey, OFFSETS) > 0.8


def test_contrast_of_chroma_may_come_back_as_luminance():
    lab = isoluminant_stripes()
    as_luminance = torch.stack([60.0 + lab[:, 1] - 20.0, 0.0 * lab[:, 1], 0.0 * lab[:, 2]], 1)
    assert contrast_distance(lab, as_luminance, OFFSETS) < 1e-3


def test_additional_contrast_costs_only_on_both_sides():
    lab = isoluminant_stripes()
    more = lab * torch.tensor([1.0, 2.0, 1.0])[:, None, None]
    assert contrast_distance(lab, more, OFFSETS) < 1e-6
    assert contrast_distance(lab, more, OFFSETS, one_sided=False) > 0.1


def test_what_a_deutan_loses_costs():
    image = 0.35 + 0.3 * torch.rand(1, 3, 40, 40, generator=torch.Generator().manual_seed(0))
    assert contrast_distance(srgb_to_lab(image), srgb_to_lab(simulate(image, "deutan", 1.0)), OFFSETS) > 0.05


def test_its_gradient_is_finite_everywhere():
    image = torch.zeros(1, 3, 32, 32, requires_grad=True)
    contrast_distance(isoluminant_stripes(), srgb_to_lab(simulate(image, "deutan", 1.0)), OFFSETS).backward()
    assert torch.isfinite(image.grad).all()


def test_structure_that_comes_back_the_wrong_way_round_costs_most():
    stripes = torch.full((1, 3, 32, 32), 0.4)
    stripes[..., ::2] = 0.6
    lost, inverted = torch.full_like(stripes, 0.5), 1.0 - stripes
    costs = [float(structure_distance(stripes, seen)) for seen in (stripes, lost, inverted)]
    assert costs == sorted(costs)
    assert costs[0] == pytest.approx(0.0, abs=1e-5)
    assert costs[2] > 1.5


def test_it_is_the_share_of_neighbours_that_a_threshold_no_longer_tells_apart_averaged_over_thresholds():
    generator = torch.Generator().manual_seed(0)
    original = torch.nn.functional.interpolate(torch.rand(1, 3, 12, 12, generator=generator), (96, 96), mode="bilinear")
    seen = simulate(original, "deutan", 1.0)
    thresholds = torch.linspace(0.0, CONTRAST_CAP, 200)[1:]
    scores = [ccpr(original[0], seen[0], float(threshold)) for threshold in thresholds]
    distinct = sum(pairs for _, pairs in scores)
    lost = 1.0 - sum(share * pairs for share, pairs in scores if pairs) / distinct
    mean = (srgb_to_lab(original)[..., 1:] - srgb_to_lab(original)[..., :-1]).norm(dim=1).mean()
    stabilised = lost * mean / (mean + STABILISER)
    assert contrast_distance(srgb_to_lab(original), srgb_to_lab(seen)) == pytest.approx(float(stabilised), rel=0.1)


def test_pairs_further_apart_than_the_image_are_those_across_it():
    lab = srgb_to_lab(torch.rand(1, 3, 20, 20))
    assert contrast_distance(lab, lab * 0.5, (999,)) == contrast_distance(lab, lab * 0.5, (19,))


def test_the_adversaries_want_opposite_things():
    high, low = torch.full((1, 1, 4, 4), 3.0), torch.full((1, 1, 4, 4), -3.0)
    assert generator_loss(high) < generator_loss(low)
    assert discriminator_loss(high, low) < discriminator_loss(low, high)
