"""The warping error measures what views disagree about, and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cvdgs.core.consistency import Correspondences, relative_warping_error

from . import scenes

VIEWS = [scenes.camera_at((x, -0.3, -4.0)) for x in (-0.6, -0.2, 0.2, 0.6)]
PLANES = [scenes.Plane((0.0, 0.1, 1.0), 1.0), scenes.Plane((0.0, 0.0, 1.0), -0.3, half_width=0.4, tint=0.2)]
PAIRS = [(0, 1), (1, 2), (2, 3)]


@pytest.fixture(scope="module")
def scene() -> tuple[list[np.ndarray], list[Correspondences]]:
    images, depths, alphas, _ = scenes.render_all(VIEWS, PLANES)
    return images, scenes.match(depths, alphas, VIEWS, PAIRS)


def drifted(images: list[np.ndarray], amount: float) -> list[np.ndarray]:
    """Every other view brighter: a drift of `amount` in each channel between adjacent views."""
    return [image + amount * (number % 2) for number, image in enumerate(images)]


def test_views_of_one_surface_agree_up_to_resampling(scene) -> None:
    images, correspondences = scene
    error = relative_warping_error(images, images, correspondences)
    assert error.absolute < 0.002
    assert error.ratio == 1.0
    assert error.normalised_ratio == pytest.approx(1.0)
    assert error.view_pairs == 3
    assert error.correspondences == sum(map(len, correspondences)) > 5000


def test_a_constant_image_scores_zero(scene) -> None:
    images, correspondences = scene
    constant = [np.full_like(image, 0.5) for image in images]
    error = relative_warping_error(images, constant, correspondences)
    assert (error.ratio, error.absolute, error.e_warp) == (0.0, 0.0, 0.0)
    assert math.isnan(error.normalised_ratio)  # there is no contrast to relate it to


def test_injected_drift_gives_the_computed_values(scene) -> None:
    images, correspondences = scene
    originals, enhanced = drifted(images, 0.05), drifted(images, 0.15)
    error = relative_warping_error(originals, enhanced, correspondences)
    # Every difference is the drift, give or take the resampling of the texture (below 0.002 on average).
    assert error.absolute_original == pytest.approx(0.05, abs=0.002)
    assert error.absolute == pytest.approx(0.15, abs=0.002)
    assert error.ratio == pytest.approx(3.0, rel=0.03)
    assert error.e_warp == pytest.approx(3 * 0.15**2, rel=0.03)
    assert error.e_warp_original == pytest.approx(3 * 0.05**2, rel=0.05)


def test_scaling_the_contrast_scales_the_ratio_but_not_the_normalised_ratio(scene) -> None:
    images, correspondences = scene
    originals = drifted(images, 0.05)
    flattened = [0.5 + 0.25 * (image - 0.5) for image in originals]
    error = relative_warping_error(originals, flattened, correspondences)
    assert error.ratio == pytest.approx(0.25, rel=1e-4)
    assert error.normalised_ratio == pytest.approx(1.0, rel=1e-4)


def test_sums_over_view_pairs_are_weighted_by_their_pixels_and_e_warp_is_not() -> None:
    images = [np.zeros((4, 4, 3)), np.full((4, 4, 3), 0.1), np.full((4, 4, 3), 0.5)]
    centers = np.stack(np.meshgrid(np.arange(4) + 0.5, np.arange(4) + 0.5), -1).reshape(-1, 2).astype(np.float32)
    pixels = np.arange(16, dtype=np.int32)
    correspondences = [
        Correspondences(0, 1, pixels, centers),
        Correspondences(0, 2, pixels[:4], centers[:4]),
        Correspondences(1, 2, pixels[:0], centers[:0]),
    ]
    error = relative_warping_error(images, [image * 2 for image in images], correspondences)
    assert error.absolute_original == pytest.approx((16 * 0.1 + 4 * 0.5) / 20)
    assert error.ratio == pytest.approx(2.0)
    assert error.e_warp_original == pytest.approx((3 * 0.1**2 + 3 * 0.5**2) / 2)
    assert (error.correspondences, error.view_pairs) == (20, 2)


def test_bytes_and_floats_give_the_same_figures(scene) -> None:
    images, correspondences = scene
    as_bytes = [np.clip(image * 255, 0, 255).round().astype(np.uint8) for image in drifted(images, 0.05)]
    as_floats = [image.astype(np.float32) / 255 for image in as_bytes]
    first = relative_warping_error(as_bytes, as_floats, correspondences)
    assert first.ratio == pytest.approx(1.0, rel=1e-6)


def test_without_correspondences_nothing_can_be_said() -> None:
    images = [np.zeros((4, 4, 3))] * 2
    nothing = [Correspondences(0, 1, np.empty(0, np.int32), np.empty((0, 2), np.float32))]
    for correspondences in ([], nothing):
        error = relative_warping_error(images, images, correspondences)
        assert math.isnan(error.ratio)
        assert math.isnan(error.absolute)
        assert error.correspondences == error.view_pairs == 0
