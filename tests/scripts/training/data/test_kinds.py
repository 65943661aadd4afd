"""Every kind of image can be drawn at any size, is decided by its seed, and is worth learning from."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.core.color.metrics import ccpr
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.scripts.showroom.weaves import herringbone, plain_weave, satin, twill
from cvdgs.scripts.training.data.fields import lch_to_linear, linear_to_lab, power_noise, simulated_lab
from cvdgs.scripts.training.data.kinds import KINDS, draw, draw_image
from cvdgs.scripts.training.data.palettes import PALETTE_SIZE, confusion_directions, draw_confused_pair, draw_palette
from cvdgs.scripts.training.data.weaves import sett


@pytest.mark.parametrize("kind", KINDS)
def test_an_image_has_the_size_asked_for_and_follows_from_the_generator(kind: str) -> None:
    for height, width in ((32, 32), (45, 70)):
        first, again, other = (draw_image(kind, height, width, np.random.default_rng(seed)) for seed in (3, 3, 4))
        assert first.shape == (height, width, 3)
        assert first.dtype == np.uint8
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)


def test_textiles_in_confused_colours_lose_contrast_for_that_type_more_than_others_do() -> None:
    def kept(confuses: str, cvd: str) -> float:
        images = [draw("checks", 64, 64, np.random.default_rng(seed), confuses).image for seed in range(8)]
        tensors = [image_to_tensor(image) for image in images]
        return float(np.nanmean([ccpr(image, simulate(image, cvd, 1.0))[0] for image in tensors]))

    assert kept("deutan", "deutan") < kept("tritan", "deutan") - 0.1
    assert kept("tritan", "tritan") < kept("deutan", "tritan") - 0.1


@settings(max_examples=15, deadline=None)
@given(cvd=st.sampled_from(["protan", "deutan", "tritan"]), seed=st.integers(0, 10_000))
def test_a_confused_pair_differs_for_normal_vision_and_hardly_for_the_type(cvd: str, seed: int) -> None:
    pair = draw_confused_pair(cvd, np.random.default_rng(seed), least_contrast=20.0, most_seen=3.0)
    assert pair.min() >= 0.0
    assert pair.max() <= 1.0
    assert np.linalg.norm(np.diff(linear_to_lab(pair), axis=0)) >= 20.0 - 0.1
    assert np.linalg.norm(np.diff(simulated_lab(pair, cvd), axis=0)) <= 3.0 + 0.1


@pytest.mark.parametrize("cvd", ["protan", "deutan"])
def test_the_confusion_direction_of_a_singular_matrix_is_its_null_vector(cvd: str) -> None:
    inner = np.array([[0.3, 0.3, 0.3], [0.4, 0.3, 0.2]])
    for direction in confusion_directions(inner, cvd):
        assert np.linalg.norm(linear_simulation(cvd, 1.0).matrix @ direction) < 1e-4


def test_half_of_the_palettes_hold_confused_colours() -> None:
    generator = np.random.default_rng(0)
    palettes = [draw_palette(generator) for _ in range(60)]
    share = np.mean([palette.confuses is not None for palette in palettes])
    assert 0.3 < share < 0.7
    assert all(palette.colors.shape == (PALETTE_SIZE, 3) for palette in palettes)
    assert min(palette.colors.min() for palette in palettes) >= 0.0
    assert max(palette.colors.max() for palette in palettes) <= 1.0


def test_colours_out_of_gamut_keep_lightness_and_hue_and_lose_chroma() -> None:
    lab = linear_to_lab(lch_to_linear(np.array([60.0]), np.array([200.0]), np.array([2.0])))[0]
    assert lab[0] == pytest.approx(60.0, abs=0.1)
    assert np.arctan2(lab[2], lab[1]) == pytest.approx(2.0, abs=0.01)
    assert 20.0 < np.hypot(lab[1], lab[2]) < 200.0


def test_a_sett_is_mirrored() -> None:
    yarns = sett(draw_palette(np.random.default_rng(1)), np.random.default_rng(2))
    assert np.array_equal(yarns, yarns[::-1])


def test_weaves_have_the_floats_that_they_are_named_for() -> None:
    assert plain_weave().mean() == 0.5
    assert twill(3, 1).mean() == 0.75
    assert satin().mean() == pytest.approx(0.8)
    assert (satin().sum(0) == 4).all()  # one interlacing a yarn, and no two in line
    assert (twill()[1:, 1:] == twill()[:-1, :-1]).all()
    assert (twill(lean=-1)[1:, :-1] == twill(lean=-1)[:-1, 1:]).all()
    turned = herringbone(band=8)
    assert np.array_equal(turned[:, :8], turned[:, 8:][:, ::-1])


def test_noise_has_the_spectrum_asked_for() -> None:
    noise = power_noise(128, 128, 1.0, np.random.default_rng(0))[..., 0]
    assert noise.std() == pytest.approx(1.0, abs=1e-3)
    power = np.abs(np.fft.fft2(noise)) ** 2
    radius = np.hypot(*np.meshgrid(np.fft.fftfreq(128), np.fft.fftfreq(128)))
    inside = (radius > 0.02) & (radius < 0.4)
    slope = np.polyfit(np.log(radius[inside]), np.log(power[inside]), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.15)


def test_what_cannot_be_drawn_is_refused() -> None:
    generator = np.random.default_rng(0)
    with pytest.raises(ValueError, match="not a kind"):
        draw_image("velvet", 64, 64, generator)
    with pytest.raises(ValueError, match="at least 32"):
        draw_image("tartan", 31, 64, generator)


def test_drawing_leaves_torch_alone() -> None:
    state = torch.get_rng_state()
    draw_image("print", 48, 48, np.random.default_rng(0))
    assert torch.equal(state, torch.get_rng_state())
