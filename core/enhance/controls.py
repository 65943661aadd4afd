"""A control that every comparison should carry: plain contrast gain, as strong as the enhancer it stands beside.

Local contrast preservation rewards any gain in contrast, so an enhancer has shown something only where it beats a gain
that changes the images equally much.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from ..color.difference import delta_e_76
from ..color.spaces import srgb_to_lab
from ..events import Reporter
from .lut import as_float

_LARGEST_GAIN = 16.0
_BISECTIONS = 20  # to 16 / 2^20
_SAMPLES = 10_000  # pixels on which the gain is found; few enough that torch starts no threads


class ContrastGain:
    """Scales colours about the scene's mean so that the mean ΔE76 to the original is `delta_e`.

    Args:
        delta_e: mean ΔE76 over the training views to match, usually that of another enhancer.
        seed: draws the pixels on which the gain is found.
    """

    def __init__(self, delta_e: float, seed: int = 0) -> None:
        self._delta_e, self._seed = delta_e, seed
        self._gain, self._center = 1.0, np.zeros(3, np.float32)

    @property
    def gain(self) -> float:
        """The factor found by `fit`; at most 16, should no gain change the images as much as asked."""
        return self._gain

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Find the scene's mean colour and the gain, by bisection."""
        covered = [
            image.reshape(-1, 3) if alphas is None or alphas[view] is None else image[np.asarray(alphas[view]) > 0]
            for view, image in enumerate(images)
        ]
        colors = np.concatenate(covered)
        self._center = as_float(colors).mean(0, dtype=np.float64).astype(np.float32)
        sample = as_float(np.random.default_rng(self._seed).choice(colors, min(_SAMPLES, len(colors)), replace=False))
        low, high = 1.0, _LARGEST_GAIN
        for _ in range(_BISECTIONS):
            self._gain = (low + high) / 2.0
            if _mean_delta_e(sample, self(sample)) < self._delta_e:
                low = self._gain
            else:
                high = self._gain

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The image with its contrast raised."""
        return np.clip(self._center + (as_float(image) - self._center) * np.float32(self._gain), 0.0, 1.0)


def _mean_delta_e(first: NDArray[np.float32], second: NDArray[np.float32]) -> float:
    """Mean ΔE76 of two (P, 3) lists of sRGB colours."""
    labs = [srgb_to_lab(torch.from_numpy(colors.T.copy())[..., None]) for colors in (first, second)]
    return float(delta_e_76(*labs).double().mean())
