"""What is measured of photographs, on images whose faults are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from cvdgs.core.evaluate.photograph_quality import PhotographQuality, blockiness, image_shift


def scene(seed: int = 0, detail: float = 1.2) -> np.ndarray:
    """(144, 192, 3) uint8 of soft random colours."""
    rng = np.random.default_rng(seed)
    image = gaussian_filter(rng.standard_normal((144, 192, 3)), (detail, detail, 0))
    return np.clip(128 + 40 * image / image.std(), 0, 255).astype(np.uint8)


def test_the_black_around_a_subject_that_is_cut_out_is_no_darkness() -> None:
    image, alpha = scene(), np.zeros((144, 192), np.uint8)
    alpha[50:90, 60:120] = 255
    image[alpha == 0] = 0
    assert PhotographQuality.of([image]).brightness == 0.0
    assert PhotographQuality.of([image], [alpha]).brightness == pytest.approx(0.5, abs=0.05)


def test_blur_makes_a_photograph_less_sharp() -> None:
    image = scene()
    values = [PhotographQuality.of([image]).sharpness]
    for pixels in (1.0, 2.0, 4.0):
        blurred = gaussian_filter(image.astype(float), (pixels, pixels, 0)).astype(np.uint8)
        values.append(PhotographQuality.of([blurred]).sharpness)
    assert values == sorted(values, reverse=True)


def test_noise_is_no_sharpness() -> None:
    blurred = gaussian_filter(scene().astype(float), (3.0, 3.0, 0))
    noise = np.random.default_rng(1).normal(0.0, 2.0, blurred.shape)
    noisy, clean = (np.clip(np.round(image), 0, 255).astype(np.uint8) for image in (blurred + noise, blurred))
    assert PhotographQuality.of([noisy]).sharpness == pytest.approx(PhotographQuality.of([clean]).sharpness, abs=0.1)


def test_a_black_photograph_says_nothing_of_the_others_sharpness() -> None:
    sharp, black = scene(), np.zeros((144, 192, 3), np.uint8)
    assert PhotographQuality.of([sharp, black]).sharpness == PhotographQuality.of([sharp]).sharpness


def test_blocks_show_at_their_borders_alone() -> None:
    rng = np.random.default_rng(0)
    blocks = np.kron(rng.uniform(60, 180, (12, 12)), np.ones((8, 8)))
    textured = blocks + rng.normal(0.0, 4.0, blocks.shape)
    assert blockiness(textured) > 3.0
    assert blockiness(rng.normal(128.0, 20.0, (96, 96))) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("pixels", [0.5, 1.0, 3.0])
def test_a_shift_of_the_whole_image_is_found(pixels: float) -> None:
    image = scene(detail=4.0)
    moved = np.round(shift(image.astype(float), (0.0, pixels, 0.0), order=1, mode="nearest")).astype(np.uint8)
    assert image_shift(image, moved) == pytest.approx(pixels, rel=0.2)


def test_images_of_different_things_are_not_shifted() -> None:
    assert image_shift(scene(1, 4.0), scene(1, 4.0)) == pytest.approx(0.0, abs=1e-9)
    found = [image_shift(scene(seed, 4.0), scene(seed + 50, 4.0)) for seed in range(8)]
    assert sum(value > 0.0 for value in found) <= 2
