"""The contrast-gain control is as strong as asked and is no cure for confused colours."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from daltonlens import simulate as daltonlens

from cvdgs.core.color.metrics import ccpr, naturalness
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor, tensor_to_image
from cvdgs.core.errors import InputError
from cvdgs.scripts.benchmarks.baselines import ContrastGain, FidanerEnhancer, MatchedGain, mean_delta_e_76

from ...core.enhance import textiles


def photograph_like(seed: int = 0) -> np.ndarray:
    noise = torch.randn(1, 3, 8, 8, generator=torch.Generator().manual_seed(seed)) * 0.12 + 0.4
    smooth = torch.nn.functional.interpolate(noise, size=(96, 128), mode="bicubic")[0].clamp(0, 1)
    return (smooth.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)


@pytest.mark.parametrize("delta_e", [1.0, 5.0, 12.0])
def test_the_gain_changes_the_images_as_much_as_asked(delta_e: float) -> None:
    images = [photograph_like(seed) for seed in range(3)]
    control = ContrastGain(delta_e)
    control.fit(images)
    changes = [naturalness(image_to_tensor(image), image_to_tensor(control(image))).delta_e_76 for image in images]
    assert np.mean(changes) == pytest.approx(delta_e, rel=0.03)
    assert control.gain > 1.0


def test_no_change_asked_is_no_change() -> None:
    image = photograph_like()
    control = ContrastGain(0.0)
    control.fit([image])
    np.testing.assert_allclose(control(image), image / 255, atol=1e-4)


def test_uncovered_pixels_do_not_shift_the_centre() -> None:
    image, alpha = photograph_like(), np.zeros((96, 128), np.uint8)
    alpha[20:60] = 255
    spoiled = np.where(alpha[..., None] > 0, image, 255).astype(np.uint8)
    plain, masked = ContrastGain(4.0), ContrastGain(4.0)
    plain.fit([image[20:60]])
    masked.fit([spoiled], alphas=[alpha])
    assert masked.gain == pytest.approx(plain.gain, rel=1e-6)
    np.testing.assert_array_equal(masked(image), plain(image))


def test_a_gain_changes_what_is_covered_as_much_as_the_enhancer_that_it_is_matched_to() -> None:
    image, alpha = photograph_like(), np.zeros((96, 128), np.uint8)
    alpha[20:60] = 255
    cut_out = np.where(alpha[..., None] > 0, image, 255).astype(np.uint8)

    class Gain(ContrastGain):
        def fit(self, *_: object, **__: object) -> None:
            self.gain = 1.5

    reference, control = Gain(0.0), MatchedGain(Gain(0.0))
    reference.fit()
    control.fit([cut_out], alphas=[alpha])
    changes = [mean_delta_e_76(image[20:60], enhance(image)[20:60]) for enhance in (reference, control)]
    assert changes[1] == pytest.approx(changes[0], rel=0.01)


def test_a_gain_leaves_colours_on_a_confusion_line_confused() -> None:
    image = textiles.tartan("deutan")
    control = ContrastGain(10.0)
    control.fit([image])
    original = image_to_tensor(image)
    assert ccpr(original, simulate(image_to_tensor(control(image)), "deutan", 1.0))[0] < 0.5


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
    encoded = image_to_tensor(pixel)
    lost = tensor_to_image(encoded - simulate(encoded, "deutan", 1.0))
    result = FidanerEnhancer("deutan", 1.0)(pixel)
    assert result.dtype == np.float32
    assert result[0, 0, 0] == pytest.approx(200 / 255)
    assert result[0, 0, 1] == pytest.approx(np.clip(40 / 255 + 0.7 * lost[0, 0, 0] + lost[0, 0, 1], 0, 1), abs=1e-5)


@pytest.mark.parametrize(("cvd", "strength", "mentions"), [("achromat", 1.0, "achromat"), ("deutan", 2.0, "strength")])
def test_what_is_not_defined_is_refused(cvd: str, strength: float, mentions: str) -> None:
    with pytest.raises(InputError, match=mentions):
        FidanerEnhancer(cvd, 1.0, strength=strength)
