"""The figures of one colour layer: contrast, similarity, naturalness and fidelity (see `core.color.metrics`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..color.metrics import CCPR_THRESHOLD, contrast_scores, naturalness, psnr, ssim
from ..color.simulation import simulate
from ..color.spaces import image_to_tensor
from ..settings import Layer


@dataclass(frozen=True)
class LayerImages:
    """One view as the layer's metrics need it.

    Attributes:
        original: (H, W, 3) uint8, the photograph.
        enhanced: (H, W, 3) uint8, what the enhancer made of it.
        rendered: (H, W, 3) uint8, the reconstructed layer from the same camera.
        unenhanced: (H, W, 3) uint8, the reconstruction in its original colours: the control that separates what the
            enhancement gains from what the reconstruction loses.
        mask: (H, W) bool of covered pixels, or None.
    """

    original: NDArray[np.uint8]
    enhanced: NDArray[np.uint8]
    rendered: NDArray[np.uint8]
    unenhanced: NDArray[np.uint8]
    mask: NDArray[np.bool_] | None = None


def score_view(images: LayerImages, layer: Layer, simulation: str) -> dict[str, Any]:
    """The layer's entries of the report for one view; `average` makes the report's of several."""
    original, enhanced, rendered = (image_to_tensor(x) for x in (images.original, images.enhanced, images.rendered))
    mask = None if images.mask is None else torch.from_numpy(images.mask)
    simulated = {
        name: simulate(image, layer.cvd, layer.severity, simulation)
        for name, image in (
            ("input", original),
            ("enhanced", enhanced),
            ("rendered", rendered),
            ("unenhanced", image_to_tensor(images.unenhanced)),
        )
    }
    contrast = {name: contrast_scores(original, image, mask=mask) for name, image in simulated.items()}
    natural = naturalness(original, enhanced, mask=mask)
    return {
        "psnr_to_enhanced": psnr(enhanced, rendered, mask=mask),
        "ccpr": {name: scores.ccpr for name, scores in contrast.items()},
        "ccpr_mean": {name: scores.ccpr_mean for name, scores in contrast.items()},
        "ccpr_global": {name: scores.ccpr_global for name, scores in contrast.items()},
        "ccfr": {name: scores.ccfr for name, scores in contrast.items()},
        "ssim_simulated": {name: ssim(original, image, mask=mask) for name, image in simulated.items()},
        "naturalness": {"ssim": natural.ssim, "psnr": natural.psnr, "delta_e": natural.delta_e_2000},
        "pairs": float(contrast["input"].pairs),
    }


def average(views: list[dict[str, Any]]) -> dict[str, Any]:
    """The mean of each figure over the views; what no view could give is NaN, views that could not are left out."""
    merged = {key: _mean([view[key] for view in views]) for key in views[0]}
    merged["ccpr"]["tau"] = int(CCPR_THRESHOLD)
    return merged


def _mean(values: list[Any]) -> Any:
    if isinstance(values[0], dict):
        return {key: _mean([value[key] for value in values]) for key in values[0]}
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")
