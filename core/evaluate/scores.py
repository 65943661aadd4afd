"""Scores pictures against a photograph, for an observer and for normal vision (see `core.color.metrics`).

One scorer for the layers of a run, for photographs without cameras, and for the benchmarks of enhancers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..color.metrics import (
    CCPR_THRESHOLD,
    Naturalness,
    ccpr,
    ccpr_and_ccfr,
    contrast_scores,
    half_size,
    half_size_mask,
    naturalness,
    psnr,
    ssim,
)
from ..color.protected_colors import protected_masks
from ..color.simulation import Observer
from ..color.spaces import delta_e_2000, image_to_tensor

Image = NDArray[np.uint8]

PYRAMID = ("half", "quarter")
"""Sizes at which contrast is measured beside the full one."""

SIMULATED_FIGURES = (
    *("ccpr", "ccpr_mean", "ccpr_global", "ccfr", "ssim_simulated"),
    *(f"{figure}_{size}" for size in PYRAMID for figure in ("ccpr", "ccfr")),
)
"""What `Scorer.simulated` measures, beside the number of pairs."""


class Scorer:
    """Scores versions of one photograph: itself, enhanced, rendered.

    Args:
        original: (H, W, 3) uint8, the photograph.
        observer: for whom versions are simulated.
        mask: (H, W) bool, the pixels that count; None for all.
    """

    def __init__(self, original: Image, observer: Observer, mask: NDArray[np.bool_] | None = None) -> None:
        self._original, self._observer = image_to_tensor(original), observer
        self._mask = None if mask is None else torch.from_numpy(mask)

    def simulate(self, version: Image) -> Tensor:
        """(3, H, W): what the observer sees of an (H, W, 3) version."""
        return self._observer.simulate(image_to_tensor(version))

    def ccpr(self, version: Image) -> float:
        """CCPR alone, which is about three times as fast as all of `simulated`."""
        return ccpr(self._original, self.simulate(version), mask=self._mask)[0]

    def simulated(self, version: Image) -> dict[str, float]:
        """`SIMULATED_FIGURES` of what the observer sees, against the photograph, and `ContrastScores.pairs`."""
        seen = self.simulate(version)
        contrast = contrast_scores(self._original, seen, mask=self._mask)
        return self._pyramid(version) | {
            "ccpr": contrast.ccpr,
            "pairs": contrast.pairs,
            "ccpr_mean": contrast.ccpr_mean,
            "ccpr_global": contrast.ccpr_global,
            "ccfr": contrast.ccfr,
            "ssim_simulated": ssim(self._original, seen, mask=self._mask),
        }

    def _pyramid(self, version: Image) -> dict[str, float]:
        """CCPR and CCFR of smaller pictures, NaN where they have no pixels."""
        figures: dict[str, float] = {}
        original, mask, reduced = self._original, self._mask, image_to_tensor(version)
        for size in PYRAMID:
            figures |= {f"ccpr_{size}": math.nan, f"ccfr_{size}": math.nan}
            if min(original.shape[-2:]) < 4:
                continue
            original, reduced = half_size(original), half_size(reduced)
            mask = None if mask is None else half_size_mask(mask)
            figures[f"ccpr_{size}"], figures[f"ccfr_{size}"] = ccpr_and_ccfr(
                original, self._observer.simulate(reduced), mask=mask
            )
        return figures

    def naturalness(self, version: Image) -> Naturalness:
        """How close a version stays to the photograph for normal vision."""
        return naturalness(self._original, image_to_tensor(version), mask=self._mask)

    def protected(self, version: Image) -> dict[str, float]:
        """``<color>_pixels`` and their mean ΔE00 ``<color>_delta_e`` (NaN without any) for the protected colours."""
        differences = delta_e_2000(self._original, image_to_tensor(version))
        figures: dict[str, float] = {}
        for color, covered in protected_masks(self._original).items():
            counted = differences[covered if self._mask is None else covered & self._mask]
            figures |= {f"{color}_pixels": counted.numel(), f"{color}_delta_e": float(counted.double().mean())}
        return figures

    def psnr_between(self, first: Image, second: Image) -> float:
        """PSNR in dB of two versions over the pixels that count."""
        return psnr(image_to_tensor(first), image_to_tensor(second), mask=self._mask)


def score_layer(
    scorer: Scorer,
    original: Image,
    enhanced: Image,
    rendered: Image,
    unenhanced: Image,
    again: Mapping[str, Image] | None = None,
) -> dict[str, Any]:
    """A layer's entries of the report for one view, all pictures (H, W, 3); `average` combines those of several.

    Args:
        scorer: of `original`, the photograph.
        enhanced: the enhanced photograph.
        rendered: the reconstructed layer from the same camera.
        unenhanced: the reconstruction in its original colours: the control that separates what the enhancement gains
            from what the reconstruction loses.
        again: a second photograph of the view (``again``) and the same enhanced (``again_enhanced``): how much of the
            contrast is noise, which no reconstruction can have.
    """
    versions = {
        "input": original,
        "enhanced": enhanced,
        "rendered": rendered,
        "unenhanced": unenhanced,
        **(again or {}),
    }
    seen = {name: scorer.simulated(version) for name, version in versions.items()}
    natural = scorer.naturalness(enhanced)
    return {
        "psnr_to_enhanced": scorer.psnr_between(enhanced, rendered),
        **{figure: {name: figures[figure] for name, figures in seen.items()} for figure in SIMULATED_FIGURES},
        "naturalness": {"ssim": natural.ssim, "psnr": natural.psnr, "delta_e": natural.delta_e_2000},
        "pairs": float(seen["input"]["pairs"]),
    }


def average(views: list[dict[str, Any]]) -> dict[str, Any]:
    """The mean of each figure over the views in which it is finite; NaN where it is in none."""
    merged = _mean(views)
    merged["ccpr"]["tau"] = int(CCPR_THRESHOLD)
    return merged


def _mean(values: list[Any]) -> Any:
    if isinstance(values[0], dict):
        keys = dict.fromkeys(key for value in values for key in value)
        return {key: _mean([value[key] for value in values if key in value]) for key in keys}
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")
