"""The simulation of 8-bit pictures in numpy: for Blender's Python, which has no torch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import srgb
from .matrices import linear_simulation

_LEVELS = 255
_LIGHT = srgb.decode(np.arange(_LEVELS + 1) / _LEVELS)  # of each 8-bit value
_BAND = 1 << 16  # pixels at a time: large enough for numpy, small enough for the processor's cache


def simulate_bytes(picture: NDArray[np.uint8], cvd: str, severity: float, model: str = "machado") -> NDArray[np.uint8]:
    """`picture` as an observer sees it, clipped as a screen clips; the 8-bit counterpart of `simulation.simulate`.

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
        encoded = srgb.encode(np.clip(mapped, 0.0, 1.0))
        seen[start : start + _BAND] = np.round(encoded * _LEVELS).astype(np.uint8)
    return seen.reshape(picture.shape)
