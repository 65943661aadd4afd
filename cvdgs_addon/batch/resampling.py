"""Smaller pictures of pictures, as light adds up. numpy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.color import srgb

_LEVELS = 255


def downscale(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """`picture`, (H, W, 3) sRGB, `width` pixels wide: each pixel is the mean light of the area that it stands for.

    A picture that is not wider stays as it is.
    """
    height_before, width_before, _ = picture.shape
    if width_before <= width:
        return picture
    height = max(round(height_before * width / width_before), 1)
    light = srgb.decode(np.arange(_LEVELS + 1) / _LEVELS)[picture]
    rows = np.tensordot(_shares(height_before, height), light, axes=(1, 0))
    mean = _shares(width_before, width) @ rows
    return np.round(srgb.encode(np.clip(mean, 0.0, 1.0)) * _LEVELS).astype(np.uint8)


def _shares(before: int, after: int) -> NDArray[np.float64]:
    """(after, before) share of each pixel of a line in the pixels of a shorter one; rows add up to 1."""
    edges = np.linspace(0.0, before, after + 1)[:, None]
    pixels = np.arange(before)
    covered = np.clip(np.minimum(edges[1:], pixels + 1.0) - np.maximum(edges[:-1], pixels), 0.0, None)
    return covered / covered.sum(axis=1, keepdims=True)
