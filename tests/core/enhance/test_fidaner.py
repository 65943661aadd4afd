"""Error redistribution as its authors describe it, for partial deficiencies too."""

from __future__ import annotations

import numpy as np
import pytest
from daltonlens import simulate as daltonlens

from cvdgs.core.color.metrics import ccpr
from cvdgs.core.color.simulation import simulate, simulate_colors
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance.fidaner import FidanerEnhancer
from cvdgs.core.errors import InputError

from . import textiles

NOISE = np.random.default_rng(0).integers(0, 256, (13, 9, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("cvd", "deficiency"), [("protan", daltonlens.Deficiency.PROTAN), ("deutan", daltonlens.Deficiency.DEUTAN)]
)
def test_red_is_left_alone_and_its_error_goes_to_green_and_blue(cvd: str, deficiency: daltonlens.Deficiency) -> None:
    simulated = daltonlens.Simulator_Vienot1999().simulate_cvd(NOISE, deficiency, severity=1.0) / 255
    image = NOISE / 255
    lost = image - simulated
    expected = image + np.stack(
        [0 * lost[..., 0], 0.7 * lost[..., 0] + lost[..., 1], 0.7 * lost[..., 0] + lost[..., 2]], -1
    )
    result = FidanerEnhancer(cvd, 1.0, "vienot")(NOISE)
    np.testing.assert_allclose(result, expected.clip(0, 1), atol=2.0 / 255)  # the oracle cuts off at 8 bits


def test_for_tritan_vision_blue_is_left_alone() -> None:
    result = FidanerEnhancer("tritan", 1.0)(NOISE)
    np.testing.assert_allclose(result[..., 2], NOISE[..., 2] / 255, atol=1e-6)
    assert np.abs(result - NOISE / 255)[..., :2].max() > 0.1


@pytest.mark.parametrize("cvd", ["protan", "deutan", "tritan"])
def test_a_milder_deficiency_and_a_smaller_strength_change_less(cvd: str) -> None:
    def change(severity: float, strength: float) -> float:
        return float(np.abs(FidanerEnhancer(cvd, severity, strength=strength)(NOISE) - NOISE / 255).mean())

    assert change(0.0, 1.0) < 1e-6
    assert change(1.0, 0.0) == pytest.approx(0.0, abs=1e-7)
    assert 0.0 < change(0.4, 1.0) < change(1.0, 1.0)
    assert 0.0 < change(1.0, 0.3) < change(1.0, 1.0)


def test_greys_are_kept() -> None:
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    np.testing.assert_allclose(FidanerEnhancer("deutan", 1.0)(ramp), ramp / 255, atol=1e-4)


def test_a_tartan_in_confused_colours_gains_contrast() -> None:
    image = textiles.tartan("deutan")
    before, after = (
        ccpr(image_to_tensor(image), simulate(image_to_tensor(picture), "deutan", 1.0))[0]
        for picture in (image, FidanerEnhancer("deutan", 1.0)(image))
    )
    assert after > before + 0.5


def test_one_pixel_gives_one_pixel() -> None:
    pixel = np.array([[[200, 40, 30]]], np.uint8)
    lost = pixel / 255 - simulate_colors(pixel / 255, "deutan", 1.0)
    result = FidanerEnhancer("deutan", 1.0)(pixel)
    assert result.dtype == np.float32
    assert result[0, 0, 0] == pytest.approx(200 / 255)
    assert result[0, 0, 1] == pytest.approx(np.clip(40 / 255 + 0.7 * lost[0, 0, 0] + lost[0, 0, 1], 0, 1), abs=1e-5)


@pytest.mark.parametrize(("cvd", "strength", "mentions"), [("achromat", 1.0, "achromat"), ("deutan", 2.0, "strength")])
def test_what_is_not_defined_is_refused(cvd: str, strength: float, mentions: str) -> None:
    with pytest.raises(InputError, match=mentions):
        FidanerEnhancer(cvd, 1.0, strength=strength)
