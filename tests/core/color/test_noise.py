"""Noise of photographs: found where it is known, and none where there is texture alone."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from cvdgs.core.color.noise import neighbour_difference, noise_level, typical_noise
from cvdgs.core.color.spaces import srgb_to_lab


def textured(seed: int = 0) -> np.ndarray:
    """(144, 192, 3) float, 0 to 255: a soft texture with flat parts."""
    rng = np.random.default_rng(seed)
    texture = gaussian_filter(rng.standard_normal((144, 192, 3)), (1.2, 1.2, 0))
    texture *= gaussian_filter(rng.standard_normal((144, 192)), 12.0)[..., None] > 0.0
    return 128.0 + 20.0 * texture / texture.std()


def with_noise(image: np.ndarray, deviation: float, seed: int = 1) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, deviation, image.shape)
    return np.clip(np.round(image + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("deviation", [2.0, 5.0, 12.0])
def test_noise_is_found_on_a_flat_image(deviation: float) -> None:
    noise = np.random.default_rng(3).normal(0.0, deviation, (160, 160))
    assert noise_level(128.0 + noise) == pytest.approx(deviation, rel=0.2)


def test_straight_edges_and_clipped_parts_are_no_noise() -> None:
    image = np.zeros((96, 96))
    image[:, 48:] = 200.0
    assert noise_level(image) == pytest.approx(0.0, abs=1e-9)
    assert noise_level(np.zeros((64, 64))) == 0.0


@pytest.mark.parametrize("level", [0.0, 255.0])
def test_the_noise_of_a_subject_is_found_however_much_around_it_is_clipped(level: float) -> None:
    """As in cut-out photographs, at night, and before a bright window."""
    image = 128.0 + np.random.default_rng(3).normal(0.0, 5.0, (160, 160))
    image[:, 48:] = level
    assert noise_level(image) == pytest.approx(5.0, rel=0.2)


@pytest.mark.parametrize("deviation", [4.0, 10.0])
def test_the_noise_of_a_channel_is_found_behind_a_texture(deviation: float) -> None:
    photographs = [with_noise(textured(seed), deviation, seed) for seed in range(5)]
    assert typical_noise(photographs) == pytest.approx(deviation / 255.0, rel=0.2)


def test_photographs_in_good_light_have_none() -> None:
    assert typical_noise([with_noise(textured(), 0.5)]) == 0.0
    assert typical_noise([]) == 0.0


def test_a_few_noisy_photographs_do_not_make_a_capture_noisy() -> None:
    photographs = [with_noise(textured(seed), 15.0 if seed < 4 else 0.5, seed) for seed in range(10)]
    assert typical_noise(photographs) == 0.0


@pytest.mark.parametrize("grey", [60.0, 128.0, 200.0])
def test_noise_makes_neighbours_differ_by_what_is_said(grey: float) -> None:
    noise = 5.0 / 255.0
    pixels = np.random.default_rng(0).normal(grey / 255.0, noise, (3, 20_000, 2))
    lab = srgb_to_lab(torch.from_numpy(pixels))
    difference = (lab[..., 0] - lab[..., 1]).square().sum(0).mean().sqrt()
    assert float(difference) == pytest.approx(neighbour_difference(noise), rel=0.2)
