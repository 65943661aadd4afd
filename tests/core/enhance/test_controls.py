"""The contrast-gain control is as strong as asked and is no cure for confused colours."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cvdgs.core.color.metrics import ccpr, naturalness
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance.controls import ContrastGain

from . import textiles


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


def test_a_gain_leaves_colours_on_a_confusion_line_confused() -> None:
    image = textiles.tartan("deutan")
    control = ContrastGain(10.0)
    control.fit([image])
    original = image_to_tensor(image)
    assert ccpr(original, simulate(image_to_tensor(control(image)), "deutan", 1.0))[0] < 0.5
