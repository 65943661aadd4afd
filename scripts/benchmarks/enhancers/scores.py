"""The figures of one enhanced image for one observer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.color.simulation import Observer
from ....core.color.spaces import delta_e_76, image_to_tensor, srgb_to_lab
from ....core.evaluate.scores import Scorer
from ....core.settings import Layer
from .experts import ExpertScorer
from .image_sets import TestImage

ENHANCED_FOR = "machado"
"""The simulation model that enhancers are made for."""

OTHER_MODELS: Mapping[str, tuple[str, ...]] = {
    "vienot": ("protan", "deutan"),
    "brettel": ("protan", "deutan", "tritan"),
}
"""Simulation models for cross-checks, and the types that each describes."""


@dataclass(frozen=True)
class Enhanced:
    """An enhanced image.

    Attributes:
        method: label of the enhancer.
        pixels: (H, W, 3) uint8.
        fit_seconds, apply_seconds: of the enhancer.
    """

    method: str
    pixels: NDArray[np.uint8]
    fit_seconds: float
    apply_seconds: float


class Judge:
    """Scores enhanced versions of one image for one observer.

    Args:
        image_set: name of the image's set.
        image: the original.
        observer: type and severity.
        other_models: whether to score under `OTHER_MODELS` too.
    """

    def __init__(self, image_set: str, image: TestImage, observer: Layer, *, other_models: bool = True) -> None:
        self._image_set, self._image, self._observer = image_set, image, observer
        self._scorer = self._scorer_under(ENHANCED_FOR)
        others = [model for model, types in OTHER_MODELS.items() if other_models and observer.cvd in types]
        self._others = {model: self._scorer_under(model) for model in others}
        self._experts = ExpertScorer(image.pixels, Observer(observer.cvd, observer.severity, ENHANCED_FOR))
        self.ccpr_input = self._scorer.ccpr(image.pixels)
        """CCPR of the original: what makes it hard or easy."""
        self._plate_before = self._plate_difference(image.pixels)

    def ccpr(self, pixels: NDArray[np.uint8]) -> float:
        """CCPR of an enhanced image alone."""
        return self._scorer.ccpr(pixels)

    def delta_e_76(self, pixels: NDArray[np.uint8]) -> float:
        """Mean ΔE76 of an enhanced image to the original."""
        labs = [srgb_to_lab(image_to_tensor(image)) for image in (self._image.pixels, pixels)]
        return float(delta_e_76(*labs).double().mean())

    def score(self, enhanced: Enhanced) -> dict[str, Any]:
        """All figures of an enhanced image: a row of ``enhancer.csv``; NaN where a figure does not apply.

        Returns:
            ``image_set``, ``image``, ``width``, ``height`` (pixels), ``cvd``, ``severity``, ``method``: what is scored.
            ``ccpr_input``: CCPR of the original.
            ``ccpr``, ``pairs``, ``ccpr_mean``, ``ccpr_global``, ``ccfr``, ``ssim_simulated``: see `Scorer.simulated`.
            ``ccpr_vienot``, ``ccpr_brettel``: CCPR of the same enhanced image under the other models; ``ccpr_worst``:
            the least of these and of ``ccpr``.
            ``name_confusions``, ``cam_gap``, ``cam_change``, ``chromatic_difference``, ``ccpr_areas``: see
            `ExpertScorer`.
            ``ssim``, ``psnr``, ``delta_e_76``, ``delta_e_2000``: see `Naturalness`.
            ``grey_pixels``, ``grey_delta_e`` and the same of ``white`` and ``skin``: see `Scorer.protected`.
            ``plate_before``, ``plate_after``: simulated ΔE76 between figure and ground of a plate, of the original and
            the enhanced image.
            ``fit_seconds``, ``apply_seconds``: of the enhancer.
        """
        pixels = enhanced.pixels
        height, width = pixels.shape[:2]
        simulated = self._scorer.simulated(pixels)
        others = {model: scorer.ccpr(pixels) for model, scorer in self._others.items()}
        return {
            "image_set": self._image_set,
            "image": self._image.name,
            "width": width,
            "height": height,
            "cvd": self._observer.cvd,
            "severity": self._observer.severity,
            "method": enhanced.method,
            "ccpr_input": self.ccpr_input,
            **simulated,
            **{f"ccpr_{model}": others.get(model, math.nan) for model in OTHER_MODELS},
            "ccpr_worst": min(simulated["ccpr"], *others.values()) if others else simulated["ccpr"],
            **self._experts.score(pixels),
            **vars(self._scorer.naturalness(pixels)),
            **self._scorer.protected(pixels),
            "plate_before": self._plate_before,
            "plate_after": self._plate_difference(pixels),
            "fit_seconds": enhanced.fit_seconds,
            "apply_seconds": enhanced.apply_seconds,
        }

    def _scorer_under(self, model: str) -> Scorer:
        return Scorer(self._image.pixels, Observer(self._observer.cvd, self._observer.severity, model))

    def _plate_difference(self, pixels: NDArray[np.uint8]) -> float:
        """Simulated ΔE76 between the mean Lab colours of figure and ground; NaN for images without these."""
        if self._image.figure is None or self._image.ground is None:
            return math.nan
        lab = srgb_to_lab(self._scorer.simulate(pixels)).double().numpy()
        return float(np.linalg.norm(lab[:, self._image.figure].mean(1) - lab[:, self._image.ground].mean(1)))
