"""sRGB (IEC 61966-2-1) in numpy: the transfer function, its constants, and the simulation of 8-bit images.

numpy only: Blender's Python imports this.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .matrices import linear_simulation

ENCODED_KNEE = 0.04045  # up to here the encoded value is a multiple of the light ...
LINEAR_KNEE = 0.0031308  # ... which then is this
SLOPE = 12.92
OFFSET = 0.055
EXPONENT = 2.4

_LEVELS = 255
_BAND = 1 << 16  # pixels at a time: large enough for numpy, small enough for the processor's cache


def decode(encoded: ArrayLike) -> NDArray[np.float64]:
    """Linear light of display-referred values in [0, 1], of any shape."""
    value = np.asarray(encoded, np.float64)
    return np.where(value <= ENCODED_KNEE, value / SLOPE, ((value + OFFSET) / (1.0 + OFFSET)) ** EXPONENT)


def encode(light: ArrayLike) -> NDArray[np.float64]:
    """Display-referred values of linear light in [0, 1], of any shape."""
    value = np.asarray(light, np.float64)
    return np.where(value <= LINEAR_KNEE, value * SLOPE, (1.0 + OFFSET) * value ** (1.0 / EXPONENT) - OFFSET)


_LIGHT = decode(np.arange(_LEVELS + 1) / _LEVELS)  # of each 8-bit value


def simulate_bytes(picture: NDArray[np.uint8], cvd: str, severity: float, model: str = "machado") -> NDArray[np.uint8]:
    """`picture` as seen with a deficiency, clipped to the gamut; the 8-bit counterpart of `simulation.simulate`.

    Args:
        picture: (..., 3) display-referred sRGB.
        cvd: type of the deficiency, see `settings.CVD_TYPES`.
        severity: 0 (normal vision) to 1.
        model: one of `settings.SIMULATIONS`.

    Raises:
        InputError: as for `matrices.linear_simulation`.
    """
    simulation = linear_simulation(cvd, severity, model)
    pixels = np.ascontiguousarray(picture).reshape(-1, 3)
    seen = np.empty_like(pixels)
    for start in range(0, len(pixels), _BAND):
        light = _LIGHT[pixels[start : start + _BAND]]
        mapped = light @ simulation.matrix.T
        if simulation.matrix_below is not None:
            is_below = light @ simulation.separator < 0.0
            mapped[is_below] = light[is_below] @ simulation.matrix_below.T
        encoded = encode(np.clip(mapped, 0.0, 1.0))
        seen[start : start + _BAND] = np.round(encoded * _LEVELS).astype(np.uint8)
    return seen.reshape(picture.shape)
