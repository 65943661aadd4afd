"""A generator can be applied to any image, and where tiles lie does not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color.protected_colors import skin_likeness
from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance.gan.apply import average_statistics, record_statistics
from cvdgs.core.enhance.gan.apply import enhance as enhance_proposal
from cvdgs.core.enhance.gan.conditioning import palette
from cvdgs.core.enhance.gan.networks import Generator

from .networks import SMALL, random_generator

DEUTAN = Observer("deutan", 1.0)


def noise(height: int, width: int, seed: int = 0) -> torch.Tensor:
    return image_to_tensor(np.random.default_rng(seed).random((height, width, 3), dtype=np.float32))


def proposal_of(image: torch.Tensor) -> torch.Tensor:
    """A recolouring: every colour a little warmer."""
    return (image + torch.tensor([0.05, 0.0, -0.05])[:, None, None]).clamp(0.0, 1.0)


def enhance(generator, image, *arguments, **options) -> torch.Tensor:
    return enhance_proposal(generator, image, proposal_of(image), *arguments, **options)


def palette_of(image: torch.Tensor) -> torch.Tensor:
    return palette([image.permute(1, 2, 0).numpy()])


@settings(max_examples=25, deadline=None)
@given(height=st.integers(1, 70), width=st.integers(1, 70))
def test_any_size_keeps_its_size_and_its_range(height, width):
    image = noise(height, width)
    result = enhance(random_generator(), image, DEUTAN, palette_of(image))
    assert result.shape == image.shape
    assert result.min() >= 0.0
    assert result.max() <= 1.0


def test_the_random_generator_of_these_tests_does_change_images():
    image = noise(64, 64)
    assert (enhance(random_generator(), image, DEUTAN, palette_of(image)) - image).abs().mean() > 0.02


@pytest.mark.parametrize("normalisation", ["none", "scene"])
@pytest.mark.parametrize("size", [(190, 257), (97, 400)])
def test_tiles_leave_no_seams(normalisation, size):
    config = replace(SMALL, normalisation=normalisation)
    generator, image = random_generator(config), noise(*size)
    colors = palette_of(image)
    statistics = (
        record_statistics(generator, image, proposal_of(image), DEUTAN, colors) if normalisation == "scene" else None
    )
    whole = enhance(generator, image, DEUTAN, colors, statistics)
    tiled = enhance(generator, image, DEUTAN, colors, statistics, tile_size=2 * config.reach + 5 * config.stride)
    assert (whole - tiled).abs().max() < 1e-5


def test_a_pixel_changes_nothing_beyond_the_networks_reach():
    generator, image = random_generator(), noise(160, 160)
    colors, changed = palette_of(image), image.clone()
    changed[:, 80, 80] = 1.0 - changed[:, 80, 80]
    first, second = (enhance(generator, x, DEUTAN, colors) for x in (image, changed))
    rows, columns = torch.nonzero((first - second).abs().sum(0) > 0.0, as_tuple=True)
    distance = max((rows - 80).abs().max(), (columns - 80).abs().max())
    assert 8 < distance <= SMALL.reach


def test_at_severity_zero_the_identity_stays_the_identity_whatever_the_weights():
    image = noise(40, 40)
    observer = Observer("protan", 0.0)
    assert torch.equal(enhance_proposal(random_generator(), image, image, observer, palette_of(image)), image)


def test_an_untrained_generator_leaves_the_proposals_of_strong_colours_unlike_skin():
    image = noise(40, 40)
    strong = (image.amax(0) - image.amin(0) > 0.5) & (skin_likeness(image) < 0.01)
    assert strong.any()
    difference = (enhance(Generator(SMALL), image, DEUTAN, palette_of(image)) - proposal_of(image)).abs()
    assert difference[:, strong].max() < 1e-3


@given(severity=st.floats(0.0, 0.02))
@settings(max_examples=10, deadline=None)
def test_a_very_small_severity_changes_the_proposal_very_little(severity):
    image = noise(32, 32)
    result = enhance(random_generator(), image, Observer("tritan", severity), palette_of(image))
    unchanged = enhance(Generator(SMALL), image, Observer("tritan", severity), palette_of(image))
    assert (result - unchanged).abs().max() <= 0.02 * 10.0


def test_strength_blends_from_the_original():
    image = noise(32, 48)
    none, half, full = (
        enhance(random_generator(), image, DEUTAN, palette_of(image), strength=s) for s in (0.0, 0.5, 1.0)
    )
    assert torch.equal(none, image)
    assert torch.allclose(half, (image + full) / 2.0, atol=1e-6)


def test_statistics_of_one_image_are_its_own():
    generator, image = random_generator(replace(SMALL, normalisation="instance")), noise(64, 64)
    colors = palette_of(image)
    statistics = average_statistics([record_statistics(generator, image, proposal_of(image), DEUTAN, colors)])
    own = enhance(generator, image, DEUTAN, colors)
    assert torch.allclose(enhance(generator, image, DEUTAN, colors, statistics), own, atol=1e-5)


def test_averaged_statistics_are_those_of_all_pixels_together():
    first, second = torch.randn(1, 4, 8, 8), torch.randn(1, 4, 8, 8) * 3.0 + 1.0
    records = [{0: tuple(reversed(torch.var_mean(x, (2, 3), correction=0, keepdim=True)))} for x in (first, second)]
    mean, variance = average_statistics(records)[0]
    both = torch.cat([first, second], 3)
    assert torch.allclose(mean, both.mean((2, 3), keepdim=True), atol=1e-6)
    assert torch.allclose(variance, both.var((2, 3), correction=0, keepdim=True), atol=1e-5)


def test_tiles_smaller_than_the_reach_are_refused():
    with pytest.raises(ValueError, match="too small"):
        enhance(random_generator(), noise(8, 8), DEUTAN, palette_of(noise(8, 8)), tile_size=SMALL.reach)


def test_neutral_colours_stay_whatever_the_weights():
    greys = torch.linspace(0.0, 1.0, 48).expand(3, 40, 48).contiguous()
    assert torch.equal(enhance(random_generator(), greys, DEUTAN, palette_of(noise(40, 40))), greys)
