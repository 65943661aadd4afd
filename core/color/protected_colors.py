"""Which pixels an enhancer should leave alone: greys, whites and colours like skin.

Greys and whites lie near the neutral axis of CIELAB. Skin-like colours are those in the box of Chai and Ngan, "Face
segmentation using skin-color map in videophone applications" (IEEE TCSVT 9(4), 1999): Cr in [133, 173] and Cb in
[77, 127] in ITU-R BT.601 at 8 bits. Wood, sand and bread lie in the box too: "like skin" is meant literally.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .spaces import srgb_to_lab

PROTECTED_COLORS = ("grey", "white", "skin")

_NEUTRAL_CHROMA = 4.0  # CIELAB; below it few people would name a hue
_WHITE_LIGHTNESS = 85.0  # CIELAB

_SKIN_CB = (77.0, 127.0)
_SKIN_CR = (133.0, 173.0)
_SKIN_SOFTNESS = 1.5  # 8-bit levels over which the likeness falls off at the border of the box
# ITU-R BT.601, 8 bits: offset and excursion of the colour difference signals, and the luma weights.
_CHROMA_OFFSET, _CHROMA_RANGE = 128.0, 224.0
_RED_WEIGHT, _GREEN_WEIGHT, _BLUE_WEIGHT = 0.299, 0.587, 0.114


def protected_masks(image: Tensor) -> dict[str, Tensor]:
    """(..., H, W) bool masks of a (..., 3, H, W) sRGB image by the names of `PROTECTED_COLORS`; whites are grey too."""
    lightness, a, b = srgb_to_lab(image).unbind(-3)
    grey = torch.hypot(a, b) < _NEUTRAL_CHROMA
    return {"grey": grey, "white": grey & (lightness > _WHITE_LIGHTNESS), "skin": skin_like(image)}


def skin_like(image: Tensor) -> Tensor:
    """(..., H, W) bool: the pixels of a (..., 3, H, W) sRGB image whose colour is like skin."""
    return _depth_in_box(image) >= 0.0


def skin_likeness(image: Tensor) -> Tensor:
    """(..., H, W) in [0, 1]: how much like skin the colours are, 0.5 at the border of the box and smooth across it."""
    return torch.sigmoid(_depth_in_box(image) / _SKIN_SOFTNESS)


def _depth_in_box(image: Tensor) -> Tensor:
    """(..., H, W) distance to the nearest side of the box in 8-bit levels, negative outside."""
    red, green, blue = image.unbind(-3)
    luma = _RED_WEIGHT * red + _GREEN_WEIGHT * green + _BLUE_WEIGHT * blue
    cb = _CHROMA_OFFSET + _CHROMA_RANGE * 0.5 * (blue - luma) / (1.0 - _BLUE_WEIGHT)
    cr = _CHROMA_OFFSET + _CHROMA_RANGE * 0.5 * (red - luma) / (1.0 - _RED_WEIGHT)
    sides = [cb - _SKIN_CB[0], _SKIN_CB[1] - cb, cr - _SKIN_CR[0], _SKIN_CR[1] - cr]
    return torch.stack(sides).amin(0)
