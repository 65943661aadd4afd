"""The figures of one enhanced image for one observer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ...color.difference import delta_e_76, delta_e_2000
from ...color.held_colors import HELD_COLORS, held_masks
from ...color.metrics import ccpr, contrast_scores, psnr, ssim
from ...color.simulation import simulate
from ...color.spaces import image_to_tensor, srgb_to_lab
from ...settings import Layer
from .image_sets import TestImage

ENHANCED_FOR = "machado"
"""The simulation model that enhancers of the comparison are made for."""

OTHER_MODELS: Mapping[str, tuple[str, ...]] = {
    "vienot": ("protan", "deutan"),
    "brettel": ("protan", "deutan", "tritan"),
}
"""Simulation models that judge as well, and the types that each describes."""


@dataclass(frozen=True)
class EnhancerScores:
    """One image, one observer, one enhancer. NaN where a figure does not apply.

    Attributes:
        image_set, image: which image.
        width, height: its size in pixels.
        cvd, severity: the observer.
        method: name of the enhancer.
        ccpr_input: CCPR of the unenhanced image: what makes it hard or easy.
        ccpr, pairs, ccpr_mean, ccpr_global, ccfr: see `ContrastScores`, under `ENHANCED_FOR`.
        ccpr_vienot, ccpr_brettel: CCPR of the same enhanced image under the other models.
        ssim_simulated: SSIM(original, S(enhanced)).
        ssim, psnr, delta_e_76, delta_e_2000: of the enhanced image against the original; means over pixels.
        grey_pixels, white_pixels, skin_pixels: how many pixels of `held_masks` the image has.
        grey_delta_e, white_delta_e, skin_delta_e: mean ΔE00 on them.
        plate_before, plate_after: ΔE76 between figure and ground of a plate through S, of the original and the enhanced
            image.
        fit_seconds, apply_seconds: what the enhancer took for this image.
    """

    image_set: str
    image: str
    width: int
    height: int
    cvd: str
    severity: float
    method: str
    ccpr_input: float
    ccpr: float
    pairs: int
    ccpr_mean: float
    ccpr_global: float
    ccfr: float
    ccpr_vienot: float
    ccpr_brettel: float
    ssim_simulated: float
    ssim: float
    psnr: float
    delta_e_76: float
    delta_e_2000: float
    grey_pixels: int
    grey_delta_e: float
    white_pixels: int
    white_delta_e: float
    skin_pixels: int
    skin_delta_e: float
    plate_before: float
    plate_after: float
    fit_seconds: float
    apply_seconds: float


@dataclass(frozen=True)
class Enhanced:
    """What an enhancer made of an image.

    Attributes:
        method: its name.
        pixels: (H, W, 3) uint8.
        fit_seconds, apply_seconds: what it took.
    """

    method: str
    pixels: NDArray[np.uint8]
    fit_seconds: float
    apply_seconds: float


class Judge:
    """Scores enhanced versions of one image for one observer.

    Args:
        image_set: name of the set that the image is from.
        image: the original.
        observer: type and severity.
        other_models: whether the models of `OTHER_MODELS` judge too.
    """

    def __init__(self, image_set: str, image: TestImage, observer: Layer, *, other_models: bool = True) -> None:
        self._image_set, self._image, self._observer = image_set, image, observer
        self._original = image_to_tensor(image.pixels)
        self._held = held_masks(self._original)
        self._models = [model for model, types in OTHER_MODELS.items() if other_models and observer.cvd in types]
        self._ccpr_input, _ = ccpr(self._original, self._seen(self._original))
        self._plate_before = self._plate_difference(self._original)

    @property
    def ccpr_input(self) -> float:
        """CCPR of the original."""
        return self._ccpr_input

    def ccpr(self, pixels: NDArray[np.uint8]) -> float:
        """CCPR of an enhanced image alone."""
        return ccpr(self._original, self._seen(image_to_tensor(pixels)))[0]

    def delta_e_76(self, pixels: NDArray[np.uint8]) -> float:
        """Mean ΔE76 of an enhanced image to the original."""
        return _mean(delta_e_76(srgb_to_lab(self._original), srgb_to_lab(image_to_tensor(pixels))))

    def score(self, enhanced: Enhanced) -> EnhancerScores:
        """All figures of an enhanced image."""
        image = image_to_tensor(enhanced.pixels)
        seen = self._seen(image)
        contrast = contrast_scores(self._original, seen)
        differences = delta_e_2000(self._original, image)
        under = {model: ccpr(self._original, self._seen(image, model))[0] for model in self._models}
        held = {name: differences[self._held[name]] for name in HELD_COLORS}
        height, width = enhanced.pixels.shape[:2]
        return EnhancerScores(
            image_set=self._image_set,
            image=self._image.name,
            width=width,
            height=height,
            cvd=self._observer.cvd,
            severity=self._observer.severity,
            method=enhanced.method,
            ccpr_input=self._ccpr_input,
            ccpr=contrast.ccpr,
            pairs=contrast.pairs,
            ccpr_mean=contrast.ccpr_mean,
            ccpr_global=contrast.ccpr_global,
            ccfr=contrast.ccfr,
            ccpr_vienot=under.get("vienot", math.nan),
            ccpr_brettel=under.get("brettel", math.nan),
            ssim_simulated=ssim(self._original, seen),
            ssim=ssim(self._original, image),
            psnr=psnr(self._original, image),
            delta_e_76=self.delta_e_76(enhanced.pixels),
            delta_e_2000=_mean(differences),
            grey_pixels=held["grey"].numel(),
            grey_delta_e=_mean(held["grey"]),
            white_pixels=held["white"].numel(),
            white_delta_e=_mean(held["white"]),
            skin_pixels=held["skin"].numel(),
            skin_delta_e=_mean(held["skin"]),
            plate_before=self._plate_before,
            plate_after=self._plate_difference(image),
            fit_seconds=enhanced.fit_seconds,
            apply_seconds=enhanced.apply_seconds,
        )

    def _seen(self, image: Tensor, model: str = ENHANCED_FOR) -> Tensor:
        return simulate(image, self._observer.cvd, self._observer.severity, model)

    def _plate_difference(self, image: Tensor) -> float:
        """ΔE76 between the mean Lab colours of figure and ground through S; NaN where there are none."""
        if self._image.figure is None or self._image.ground is None:
            return math.nan
        lab = srgb_to_lab(self._seen(image)).double().numpy()
        return float(np.linalg.norm(lab[:, self._image.figure].mean(1) - lab[:, self._image.ground].mean(1)))


def _mean(values: Tensor) -> float:
    """NaN without values."""
    return float(values.double().mean())
