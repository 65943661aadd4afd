"""Greys, whites and skin-like colours are found where published rules say."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from cvdgs.core.color.protected_colors import protected_masks, skin_like, skin_likeness
from cvdgs.core.color.spaces import image_to_tensor


def held(*color):
    masks = protected_masks(image_to_tensor(np.full((1, 1, 3), color, np.uint8)))
    return {name for name, mask in masks.items() if mask.item()}


@given(st.integers(0, 255))
def test_greys_are_grey_and_the_light_ones_white(level):
    # sRGB 216 is L* 86, 209 is L* 84
    assert held(level, level, level) >= {"grey"} | ({"white"} if level >= 216 else set())
    assert level >= 216 or level > 209 or "white" not in held(level, level, level)


@pytest.mark.parametrize("color", [(194, 150, 130), (115, 82, 68)], ids=["light skin", "dark skin"])
def test_the_skin_patches_of_the_colour_checker_are_like_skin(color):
    assert held(*color) == {"skin"}


@pytest.mark.parametrize("color", [(70, 148, 73), (56, 61, 150), (231, 199, 31), (160, 160, 160)])
def test_green_blue_yellow_and_grey_are_not_like_skin(color):
    assert "skin" not in held(*color)


@given(hnp.arrays(np.uint8, (4, 4, 3)))
def test_skin_agrees_with_pillows_ycbcr(image):
    full = np.asarray(Image.fromarray(image).convert("YCbCr"), float)[..., 1:]
    cb, cr = np.moveaxis(128.0 + (full - 128.0) * 224.0 / 255.0, -1, 0)  # full to video range
    found = protected_masks(image_to_tensor(image))["skin"].numpy()
    surely = (cb > 78) & (cb < 126) & (cr > 134) & (cr < 172)  # Pillow rounds
    possibly = (cb > 76) & (cb < 128) & (cr > 132) & (cr < 174)
    assert found[surely].all()
    assert not found[~possibly].any()


def test_skin_likeness_is_the_boxs_smooth_version():
    image = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0))
    assert torch.equal(skin_likeness(image) >= 0.5, skin_like(image))
    brown = torch.tensor([0.70, 0.50, 0.40])[:, None, None]
    assert skin_likeness(brown) > 0.95
    assert skin_likeness(torch.tensor([0.2, 0.6, 0.9])[:, None, None]) < 0.01
    steps = torch.diff(
        skin_likeness(torch.lerp(torch.full((3, 1, 256), 0.5), brown.expand(3, 1, 256), torch.linspace(0, 1, 256)))
    )
    assert steps.abs().max() < 0.05
