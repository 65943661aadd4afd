"""The simulation S agrees with colorspacious, keeps what it must keep, and is differentiable."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from colorspacious import cspace_convert
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color.simulation import simulate
from cvdgs.core.errors import InputError

COLORSPACIOUS_NAMES = {"protan": "protanomaly", "deutan": "deuteranomaly", "tritan": "tritanomaly"}


def simulate_colors(colors: np.ndarray, cvd: str, severity: float) -> np.ndarray:
    """S of (N, 3) colours."""
    return simulate(torch.from_numpy(colors.T.copy())[..., None], cvd, severity)[..., 0].T.numpy()


def oracle(colors: np.ndarray, cvd: str, severity: float) -> np.ndarray:
    space = {"name": "sRGB1+CVD", "cvd_type": COLORSPACIOUS_NAMES[cvd], "severity": 100.0 * severity}
    return np.clip(cspace_convert(colors, space, "sRGB1"), 0.0, 1.0)


@given(st.sampled_from(sorted(COLORSPACIOUS_NAMES)), st.floats(0.0, 1.0), st.integers(0, 1000))
@settings(max_examples=50, deadline=None)
def test_machado_agrees_with_colorspacious_at_any_severity(cvd: str, severity: float, seed: int) -> None:
    colors = np.random.default_rng(seed).random((200, 3))
    np.testing.assert_allclose(simulate_colors(colors, cvd, severity), oracle(colors, cvd, severity), atol=1e-6)


def test_an_image_is_simulated_pixel_by_pixel_in_any_batch_shape() -> None:
    batch = torch.rand(2, 4, 3, 5, 7, dtype=torch.float64)
    seen = simulate(batch, "protan", 0.7)
    colors, found = (images.movedim(-3, -1).reshape(-1, 3).numpy() for images in (batch, seen))
    np.testing.assert_allclose(found, simulate_colors(colors, "protan", 0.7), atol=1e-12)


def test_single_precision_is_good_to_a_tenth_of_an_8_bit_level() -> None:
    image = torch.rand(3, 50, 50, dtype=torch.float64)
    exact = simulate(image, "deutan", 1.0)
    assert (simulate(image.float(), "deutan", 1.0) - exact).abs().max() < 0.1 / 255


@pytest.mark.parametrize("space", ["linear", "encoded"])
def test_severity_zero_returns_the_image(space: str) -> None:
    image = torch.rand(3, 8, 8)
    assert torch.equal(simulate(image, "tritan", 0.0, space=space), image)


def test_encoded_space_applies_the_matrix_to_the_encoded_values() -> None:
    color = torch.tensor([0.8, 0.3, 0.2], dtype=torch.float64)[:, None, None]
    red = 0.367322 * 0.8 + 0.860646 * 0.3 - 0.227968 * 0.2
    assert simulate(color, "deutan", 1.0, space="encoded")[0].item() == pytest.approx(red, abs=1e-12)
    assert simulate(color, "deutan", 1.0)[0].item() != pytest.approx(red, abs=0.01)


def test_results_are_clipped_to_the_gamut() -> None:
    primaries = torch.cartesian_prod(*[torch.tensor([0.0, 1.0])] * 3).T[..., None]
    for cvd in ("protan", "deutan", "tritan", "achromat"):
        seen = simulate(primaries, cvd, 1.0)
        assert seen.min() >= 0.0
        assert seen.max() <= 1.0


@pytest.mark.parametrize(
    ("cvd", "model"),
    [(c, "machado") for c in ("protan", "deutan", "tritan", "achromat")]
    + [("protan", "vienot"), ("deutan", "brettel"), ("tritan", "brettel")],
)
def test_the_gradient_is_that_of_finite_differences(cvd: str, model: str) -> None:
    generator = torch.Generator().manual_seed(3)
    # Mid-tones: nothing is clipped, and nothing sits on a kink of the transfer function.
    image = 0.45 + 0.1 * torch.rand(3, 4, 4, generator=generator, dtype=torch.float64)
    image.requires_grad_(True)
    assert torch.autograd.gradcheck(lambda x: simulate(x, cvd, 0.65, model), image)


def test_gradients_are_finite_at_black_and_white_and_vanish_where_clipped() -> None:
    image = torch.tensor([[0.0, 1.0, 1.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])[..., None].requires_grad_(True)
    seen = simulate(image, "protan", 1.0)
    seen.sum().backward()
    assert torch.isfinite(image.grad).all()
    # Pure red: blue would be negative and is clipped, so it must not pull.
    blue = torch.autograd.grad(simulate(image, "protan", 1.0)[2, 2, 0], image)[0]
    assert not blue.any()


def test_an_unknown_space_is_refused() -> None:
    with pytest.raises(InputError, match="space"):
        simulate(torch.rand(3, 2, 2), "deutan", 1.0, space="lab")
