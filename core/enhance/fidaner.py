"""The classic "daltonize" as a control: what a simulation takes away, redistributed into channels that are seen.

After Fidaner, Lin and Ozguven, "Analysis of Color Blindness" (Stanford, Psych 221, 2005), whose method most daltonising
programs still use: result = image + M (image - S(image)).

The original works on encoded values throughout. Here the error is taken and redistributed between encoded values as
there, but S is the product's own, in linear light, so that every method is compared for one and the same observer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..color.matrices import check_simulation
from ..color.simulation import simulate
from ..color.spaces import image_to_tensor, tensor_to_image
from ..errors import InputError
from .enhancer import SceneIndependent, check_strength
from .lut import as_float

# M, from the (red, green, blue) error to what is added. Red-green observers keep blue and overall lightness, so the
# error of red goes to green and blue: the original's matrix. It would give tritan observers their errors back in blue,
# which is what they lose, so for them the error of blue goes to red and green, as in later programs.
_FROM_RED = np.array([[0.0, 0.0, 0.0], [0.7, 1.0, 0.0], [0.7, 0.0, 1.0]], np.float32)
_FROM_BLUE = np.array([[1.0, 0.0, 0.7], [0.0, 1.0, 0.7], [0.0, 0.0, 0.0]], np.float32)
_REDISTRIBUTION = {"protan": _FROM_RED, "deutan": _FROM_RED, "tritan": _FROM_BLUE}


class FidanerEnhancer(SceneIndependent):
    """Adds the redistributed error of the simulation to the image.

    Args:
        cvd, severity, simulation: the observer, as for `simulate`; the method knows no "achromat".
        strength: the share of the redistributed error that is added; 1 as published.
    """

    def __init__(self, cvd: str, severity: float, simulation: str = "machado", strength: float = 1.0) -> None:
        check_simulation(cvd, severity, simulation)
        if cvd not in _REDISTRIBUTION:
            raise InputError(
                f"error redistribution is not defined for {cvd} vision",
                remedy=f"use {', '.join(_REDISTRIBUTION)}, or another enhancer",
            )
        check_strength(strength)
        self._observer = (cvd, severity, simulation)
        self._matrix = _REDISTRIBUTION[cvd] * np.float32(strength)

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """(H, W, 3) uint8, or float in [0, 1], to the recoloured (H, W, 3) float32 image in [0, 1]."""
        pixels = as_float(image)
        error = pixels - tensor_to_image(simulate(image_to_tensor(pixels), *self._observer))
        return np.clip(pixels + error @ self._matrix.T, 0.0, 1.0)
