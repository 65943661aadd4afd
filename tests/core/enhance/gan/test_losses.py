"""The contrast loss sees lost contrast of any kind, and nothing where nothing is lost."""

from __future__ import annotations

import pytest
import torch

from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import srgb_to_lab
from cvdgs.core.enhance.gan.losses import contrast_distance, discriminator_loss, generator_loss

WINDOWS = (3, 11)


def isoluminant_stripes() -> torch.Tensor:
    """(1, 3, 32, 32) stripes that differ in a* alone."""
    lab = torch.zeros(1, 3, 32, 32)
    lab[:, 0], lab[:, 1, :, ::4], lab[:, 1, :, 1::4] = 60.0, 40.0, 40.0
    return lab


def test_what_is_seen_unchanged_costs_nothing():
    lab = srgb_to_lab(torch.rand(2, 3, 40, 40))
    assert contrast_distance(lab, lab, WINDOWS) == pytest.approx(0.0, abs=1e-6)


def test_flat_images_cost_nothing():
    lab = torch.full((1, 3, 32, 32), 50.0)
    assert contrast_distance(lab, lab + 7.0, WINDOWS) == pytest.approx(0.0, abs=1e-6)


def test_a_lost_isoluminant_edge_costs():
    lab = isoluminant_stripes()
    grey = lab * torch.tensor([1.0, 0.0, 0.0])[:, None, None]
    assert contrast_distance(lab, grey, WINDOWS) > 0.9


def test_contrast_of_chroma_may_come_back_as_luminance():
    lab = isoluminant_stripes()
    as_luminance = torch.stack([60.0 + lab[:, 1] - 20.0, 0.0 * lab[:, 1], 0.0 * lab[:, 2]], 1)
    assert contrast_distance(lab, as_luminance, WINDOWS) < 1e-3


def test_additional_contrast_costs_only_on_both_sides():
    lab = isoluminant_stripes()
    more = lab * torch.tensor([1.0, 2.0, 1.0])[:, None, None]
    assert contrast_distance(lab, more, WINDOWS) < 1e-6
    assert contrast_distance(lab, more, WINDOWS, one_sided=False) > 0.1


def test_what_a_deutan_loses_costs():
    image = torch.rand(1, 3, 40, 40)
    assert contrast_distance(srgb_to_lab(image), srgb_to_lab(simulate(image, "deutan", 1.0)), WINDOWS) > 0.02


def test_its_gradient_is_finite_everywhere():
    image = torch.zeros(1, 3, 32, 32, requires_grad=True)
    contrast_distance(isoluminant_stripes(), srgb_to_lab(simulate(image, "deutan", 1.0)), WINDOWS).backward()
    assert torch.isfinite(image.grad).all()


def test_a_window_larger_than_the_image_is_the_image():
    lab = isoluminant_stripes()
    assert contrast_distance(lab, lab * 0.5, (999,)) == contrast_distance(lab, lab * 0.5, (32,))


def test_the_adversaries_want_opposite_things():
    high, low = torch.full((1, 1, 4, 4), 3.0), torch.full((1, 1, 4, 4), -3.0)
    assert generator_loss(high) < generator_loss(low)
    assert discriminator_loss(high, low) < discriminator_loss(low, high)
