"""The gradient teacher gives back what an observer loses, and nothing where nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color.metrics import ccpr
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor, srgb_to_lab
from cvdgs.core.errors import InputError
from cvdgs.scripts.training.gradient_teacher import GradientSettings, GradientTeacher, _screened_poisson

from ...core.enhance import textiles


def seen_contrast(image: np.ndarray, result: np.ndarray, cvd: str) -> float:
    return ccpr(image_to_tensor(image), simulate(image_to_tensor(result), cvd, 1.0))[0]


@pytest.mark.parametrize("cvd", ["protan", "deutan"])
def test_a_tartan_in_confused_colours_becomes_distinct(cvd: str) -> None:
    image = textiles.tartan(cvd)
    teacher = GradientTeacher(cvd, 1.0)
    teacher.fit([image])
    assert seen_contrast(image, image, cvd) < 0.1
    assert seen_contrast(image, teacher(image), cvd) > 0.95


@pytest.mark.parametrize("cvd", ["protan", "deutan", "tritan"])
def test_an_unreadable_plate_becomes_readable(cvd: str) -> None:
    image, labels = textiles.plate(cvd)

    def difference(picture: np.ndarray) -> float:
        lab = srgb_to_lab(simulate(image_to_tensor(picture), cvd, 1.0)).numpy()
        return float(np.linalg.norm(lab[:, labels == 2].mean(1) - lab[:, labels == 1].mean(1)))

    assert difference(GradientTeacher(cvd, 1.0)(image)) > difference(image) + 10.0


def test_views_of_one_scene_agree_on_directions_that_their_own_fits_need_not_share() -> None:
    views = [textiles.tartan(shift=shift) for shift in (0, 5)]
    teacher = GradientTeacher("deutan", 1.0)
    teacher.fit(views)
    chosen = teacher.directions
    assert chosen is not None
    for view in views:
        teacher(view)
        assert teacher.directions is chosen
    assert float(chosen.lost @ chosen.visible) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("level", [0, 90, 255])
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (24, 31)])
def test_greys_are_returned_as_they_are_at_any_size(shape: tuple[int, int], level: int) -> None:
    image = np.full((*shape, 3), level, np.uint8)
    image[..., :, :] = (image + np.arange(shape[1], dtype=np.uint8)[None, :, None] // 2).astype(np.uint8)
    result = GradientTeacher("deutan", 1.0)(image)
    assert result.dtype == np.float32
    np.testing.assert_allclose(result, image / 255, atol=2e-3)


def test_greys_beside_colours_keep_their_place() -> None:
    image = textiles.tartan()
    image[40:80, 40:80] = 128
    result = GradientTeacher("deutan", 1.0)(image)
    assert np.abs(result[40:80, 40:80] - 128 / 255).max() < 0.5 / 255
    assert np.abs(result - image / 255).max() > 0.1


@pytest.mark.parametrize(("severity", "strength"), [(0.0, 1.0), (1.0, 0.0)])
def test_severity_or_strength_zero_is_the_identity(severity: float, strength: float) -> None:
    image = textiles.tartan()
    teacher = GradientTeacher("deutan", severity, strength=strength)
    teacher.fit([image])
    np.testing.assert_array_equal(teacher(image), image.astype(np.float32) / np.float32(255))


def test_half_the_strength_is_a_smaller_change() -> None:
    image = textiles.tartan()
    half, full = (GradientTeacher("deutan", 1.0, strength=strength)(image) - image / 255 for strength in (0.5, 1.0))
    assert 0.3 < np.abs(half).mean() / np.abs(full).mean() < 0.8


@given(st.integers(1, 12), st.integers(1, 12), st.sampled_from(["protan", "deutan", "tritan", "achromat"]))
@settings(deadline=None, max_examples=25)
def test_any_image_stays_in_gamut_and_keeps_its_size(height: int, width: int, cvd: str) -> None:
    image = np.random.default_rng(height * 13 + width).integers(0, 256, (height, width, 3), dtype=np.uint8)
    result = GradientTeacher(cvd, 1.0, settings=GradientSettings(pairs=200))(image)
    assert result.shape == image.shape
    assert np.isfinite(result).all()
    assert result.min() >= 0.0
    assert result.max() <= 1.0


def test_the_poisson_solution_is_where_its_objective_has_no_slope() -> None:
    generator = np.random.default_rng(0)
    anchor = torch.from_numpy(generator.normal(size=(9, 7)))
    down, right = torch.from_numpy(generator.normal(size=(8, 7))), torch.from_numpy(generator.normal(size=(9, 6)))
    solution = torch.from_numpy(_screened_poisson(down.numpy(), right.numpy(), anchor.numpy(), 3.0)).double()
    solution.requires_grad_(True)
    objective = (
        ((solution.diff(dim=0) - down) ** 2).sum()
        + ((solution.diff(dim=1) - right) ** 2).sum()
        + ((solution - anchor) ** 2).sum() / 9.0
    )
    objective.backward()
    assert solution.grad is not None
    assert solution.grad.abs().max() < 1e-4


def test_a_strength_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match="strength"):
        GradientTeacher("deutan", 1.0, strength=1.5)
