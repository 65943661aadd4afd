"""How noisy photographs are, and how different noise makes neighbouring pixels look. numpy and scipy only."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve

_LUMA = np.array([0.2126, 0.7152, 0.0722])  # of Rec. 709, on encoded values, as in video
# Immerkær (1996), "Fast noise variance estimation": differences of two Laplacians, blind to straight edges.
_NOISE_MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]])
_BLOCK = 16  # pixels
_FLATTEST = 10  # percentile of the blocks: noise is everywhere, texture is not
_BLACK, _WHITE = 8.0, 247.0  # beyond these a block is clipped, and noise with it
_MEASURED = 12  # photographs, at most
_QUIET = 1.5  # levels of luma; photographs in good light, which hold texture everywhere, show up to 1.0
_NEIGHBOURS_DIFFER = 1.5 * 255.0  # ΔE76 of two pixels per unit of noise, rms: 1.3 in light greys, 1.9 in dark ones


def luma(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(H, W) in [0, 255] of an (H, W, 3) image."""
    return image @ _LUMA


def noise_level(image: NDArray[np.float64]) -> float:
    """Standard deviation of white noise in the flattest blocks of an (H, W) image; 0 if all are clipped."""
    residual = np.abs(convolve(image, _NOISE_MASK, mode="nearest")) / np.linalg.norm(_NOISE_MASK)
    deviations, means = (_blocks(values).mean(axis=(1, 3)) for values in (residual, image))
    usable = (means > _BLACK) & (means < _WHITE)
    # For a normal distribution the mean magnitude is sqrt(2 / pi) of the standard deviation.
    return float(np.sqrt(np.pi / 2) * np.percentile(deviations[usable], _FLATTEST)) if usable.any() else 0.0


def typical_noise(photographs: Sequence[NDArray[np.uint8]]) -> float:
    """Standard deviation of the noise in each channel of (H, W, 3) photographs, in [0, 1]; their median.

    0 where there is hardly any: what is measured then is texture.
    """
    chosen = photographs[:: max(math.ceil(len(photographs) / _MEASURED), 1)]
    level = float(np.median([noise_level(luma(image)) for image in chosen])) if len(chosen) else 0.0
    return level / (255.0 * float(np.linalg.norm(_LUMA))) if level > _QUIET else 0.0


def neighbour_difference(noise: float) -> float:
    """ΔE76 by which noise alone makes two pixels differ, rms.

    Args:
        noise: standard deviation in each channel, in [0, 1].
    """
    return _NEIGHBOURS_DIFFER * noise


def _blocks(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """(rows, _BLOCK, columns, _BLOCK) view of an image, cropped to whole blocks."""
    side = min(_BLOCK, *image.shape)
    rows, columns = (length // side for length in image.shape)
    return image[: rows * side, : columns * side].reshape(rows, side, columns, side)
