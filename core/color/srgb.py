"""The transfer function of sRGB (IEC 61966-2-1) in numpy, and its constants for those who write it otherwise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

ENCODED_KNEE = 0.04045  # up to here the encoded value is a multiple of the light ...
LINEAR_KNEE = 0.0031308  # ... which then is this
SLOPE = 12.92
OFFSET = 0.055
EXPONENT = 2.4


def decode(encoded: ArrayLike) -> NDArray[np.float64]:
    """Linear light of display-referred values in [0, 1], of any shape."""
    value = np.asarray(encoded, np.float64)
    return np.where(value <= ENCODED_KNEE, value / SLOPE, ((value + OFFSET) / (1.0 + OFFSET)) ** EXPONENT)


def encode(light: ArrayLike) -> NDArray[np.float64]:
    """Display-referred values of linear light in [0, 1], of any shape."""
    value = np.asarray(light, np.float64)
    return np.where(value <= LINEAR_KNEE, value * SLOPE, (1.0 + OFFSET) * value ** (1.0 / EXPONENT) - OFFSET)
