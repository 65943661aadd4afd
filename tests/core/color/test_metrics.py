"""The metrics are what notes and papers define: checked against slow direct implementations and known cases."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
import pytest
import torch
from colorspacious import cspace_convert
from scipy.ndimage import gaussian_filter

from cvdgs.core.color.metrics import ccpr, contrast_scores, half_size, half_size_mask, naturalness, psnr, ssim
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import linear_to_srgb


def random_image(height: int, width: int, seed: int = 0, spread: float = 0.15) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return (0.4 + spread * torch.randn(3, height, width, generator=generator)).clamp(0.0, 1.0)


def red_green_stripes(size: int = 32) -> torch.Tensor:
    """Stripes of two colours on one deutan confusion line: the null direction of the Machado matrix, equal for S."""
    matrix = np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]])
    confused = np.linalg.svd(matrix)[2][-1] * 0.1
    linear = torch.full((3, size, size), 0.2, dtype=torch.float64)
    linear += torch.from_numpy(confused)[:, None, None] * torch.where(torch.arange(size) // 4 % 2 == 0, 1.0, -1.0)
    return linear_to_srgb(linear)


def slow_pair_differences(image: torch.Tensor) -> np.ndarray:
    """ΔE76 of all 8-neighbour pairs, pixel by pixel, through colorspacious."""
    lab = cspace_convert(image.double().permute(1, 2, 0).numpy(), "sRGB1", "CIELab")
    height, width = lab.shape[:2]
    return np.array(
        [
            np.linalg.norm(lab[y, x] - lab[y + dy, x + dx])
            for y in range(height)
            for x in range(width)
            for dy, dx in ((0, 1), (1, -1), (1, 0), (1, 1))
            if 0 <= y + dy < height and 0 <= x + dx < width
        ]
    )


def test_contrast_scores_agree_with_a_direct_count_over_pairs() -> None:
    original = random_image(9, 11, spread=0.05)
    seen = simulate(original, "deutan", 1.0)
    before, after = slow_pair_differences(original), slow_pair_differences(seen)
    scores = contrast_scores(original, seen)
    preserved = [np.mean(after[before >= tau] >= tau) for tau in range(1, 16) if (before >= tau).any()]
    invented = np.mean(before[after >= 6] < 6)
    assert scores.pairs == (before >= 6).sum()
    assert scores.ccpr == pytest.approx(np.mean(after[before >= 6] >= 6))
    assert scores.ccpr_mean == pytest.approx(np.mean(preserved), abs=2e-3)
    assert scores.ccfr == pytest.approx(1 - invented)
    assert ccpr(original, seen) == (scores.ccpr, scores.pairs)


def test_normal_vision_keeps_every_contrast() -> None:
    original = random_image(20, 20)
    scores = contrast_scores(original, original)
    assert (scores.ccpr, scores.ccpr_mean, scores.ccpr_global, scores.ccfr) == (1, 1, 1, 1)


def test_colours_on_a_confusion_line_lose_all_their_contrast() -> None:
    stripes = red_green_stripes()
    scores = contrast_scores(stripes, simulate(stripes, "deutan", 1.0))
    assert scores.pairs > 0
    assert scores.ccpr == 0.0
    assert scores.ccpr_global == 0.0
    assert contrast_scores(stripes, simulate(stripes, "tritan", 1.0)).ccpr == 1.0


def test_ccpr_over_no_distinct_pair_is_nan() -> None:
    flat = torch.full((3, 6, 6), 0.5)
    scores = contrast_scores(flat, flat)
    assert scores.pairs == 0
    assert all(math.isnan(x) for x in (scores.ccpr, scores.ccpr_mean, scores.ccpr_global, scores.ccfr))
    assert math.isnan(ccpr(flat, flat)[0])


def test_invented_contrast_lowers_ccfr_and_not_ccpr() -> None:
    original = red_green_stripes().float()
    noisy = (original + 0.5 * torch.rand(original.shape, generator=torch.Generator().manual_seed(0))).clamp(0, 1)
    scores = contrast_scores(original, noisy)
    assert scores.ccfr < 0.5
    assert scores.ccpr > 0.8


def test_a_mask_leaves_uncovered_pixels_out_of_every_metric() -> None:
    original = random_image(24, 30)
    other = (original * 0.9).clone()
    spoiled = other.clone()
    spoiled[:, :, 15:] = 1.0
    mask = torch.zeros(24, 30, dtype=torch.bool)
    mask[:, :15] = True
    left = (original[:, :, :15], other[:, :, :15])
    masked, cropped = contrast_scores(original, spoiled, mask=mask), contrast_scores(*left)
    assert (masked.ccpr, masked.pairs, masked.ccpr_mean, masked.ccfr) == (
        cropped.ccpr,
        cropped.pairs,
        cropped.ccpr_mean,
        cropped.ccfr,
    )
    assert psnr(original, spoiled, mask=mask) == pytest.approx(psnr(*left))
    assert contrast_scores(original, other, mask=torch.zeros_like(mask)).pairs == 0
    assert math.isnan(contrast_scores(original, other, mask=torch.zeros_like(mask)).ccpr_global)


def test_global_ccpr_is_reproducible_and_close_to_the_exhaustive_value() -> None:
    original = random_image(8, 8, spread=0.06)
    seen = simulate(original, "deutan", 1.0)
    scores = contrast_scores(original, seen)
    assert scores.ccpr_global == contrast_scores(original, seen).ccpr_global
    labs = [cspace_convert(x.double().flatten(1).T.numpy(), "sRGB1", "CIELab") for x in (original, seen)]
    before, after = (np.linalg.norm(lab[:, None] - lab[None], axis=-1) for lab in labs)
    assert scores.ccpr_global == pytest.approx((after >= 6)[before >= 6].mean(), abs=0.01)


def test_ssim_agrees_with_a_direct_implementation_by_gaussian_filters() -> None:
    first, second = random_image(40, 36), random_image(40, 36, seed=1) * 0.5 + 0.25

    def blur(x: np.ndarray) -> np.ndarray:
        return gaussian_filter(x, 1.5, truncate=5 / 1.5, axes=(1, 2))[:, 5:-5, 5:-5]

    x, y = first.double().numpy(), second.double().numpy()
    mx, my = blur(x), blur(y)
    vx, vy, cov = blur(x * x) - mx**2, blur(y * y) - my**2, blur(x * y) - mx * my
    expected = (2 * mx * my + 1e-4) * (2 * cov + 9e-4) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4))
    assert ssim(first, second) == pytest.approx(expected.mean(), abs=1e-5)


def test_ssim_of_an_image_smaller_than_its_window_is_nan() -> None:
    assert math.isnan(ssim(random_image(10, 40), random_image(10, 40)))


def test_half_a_picture_has_the_mean_of_the_light() -> None:
    """From twice as far away black and white checks are half as bright as white, which is no middle grey."""
    checks = torch.tensor([[0.0, 1.0], [1.0, 0.0]]).repeat(3, 2, 3)
    halved = half_size(checks)
    assert halved.shape == (3, 2, 3)
    half_of_white = cspace_convert([0.5, 0.5, 0.5], "sRGB1-linear", "sRGB1")[0]
    assert halved.numpy() == pytest.approx(half_of_white, abs=1e-5)


def test_a_pixel_of_half_a_picture_counts_if_all_four_that_it_stands_for_do() -> None:
    mask = torch.ones(4, 7, dtype=torch.bool)
    mask[0, 3] = False
    assert half_size_mask(mask).tolist() == [[True, False, True], [True, True, True]]


def test_psnr_follows_its_definition() -> None:
    image = torch.full((3, 4, 4), 0.5)
    assert psnr(image, image + 0.1) == pytest.approx(20.0, abs=1e-5)
    assert psnr(image, image) == math.inf


def test_an_unchanged_image_is_perfectly_natural() -> None:
    image = random_image(20, 20)
    scores = naturalness(image, image)
    assert scores.ssim == pytest.approx(1.0, abs=1e-5)
    assert scores.delta_e_76 == pytest.approx(0.0, abs=1e-6)
    assert scores.delta_e_2000 == pytest.approx(0.0, abs=1e-6)
    assert naturalness(image, image * 0.8).delta_e_2000 > 1.0


@pytest.fixture
def one_thread() -> Iterator[None]:
    """Timings in processor time mean something only where no second thread is waited for."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.usefixtures("one_thread")
def test_contrast_preservation_of_a_training_image_takes_a_fraction_of_a_second() -> None:
    original, seen = random_image(360, 480), random_image(360, 480, seed=1)
    spent = math.inf
    for _ in range(5):
        start = time.thread_time()
        ccpr(original, seen)
        spent = min(spent, time.thread_time() - start)
    # 0.03 s of processor time here; what other processes do does not count. A loop over pairs takes seconds.
    assert spent < 0.15
