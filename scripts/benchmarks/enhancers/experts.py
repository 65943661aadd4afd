"""Measures of enhancements beside contrast and ΔE: names, appearance, chroma, areas.

CVD-MET (Optics Express 30(19) 34665, 2022) compares what an observer sees with what others see by CIECAM02; of it we
could read the abstract alone, so `cam_gap` and `cam_change` are ours and not that metric.
"""

from __future__ import annotations

import warnings

import numpy as np
import torch
from kornia.filters import gaussian_blur2d
from numpy.typing import NDArray
from torch import Tensor

from ....core.color.matrices import RGB_TO_XYZ
from ....core.color.metrics import CCPR_THRESHOLD
from ....core.color.simulation import Observer
from ....core.color.spaces import (
    delta_e_76,
    image_to_tensor,
    linear_to_srgb,
    linear_to_xyz,
    srgb_to_lab,
    srgb_to_linear,
    tensor_to_image,
)
from .color_names import confused_names

AREA_DISTANCE = 8
"""Pixels between the two of a pair of areas."""
AREA_BLUR = 2.0
"""Standard deviation in pixels of the blur, in linear light, that leaves areas without their texture."""

# IEC 61966-2-1's viewing conditions: 64 lux on a background of a fifth of white, in an average surround.
_ADAPTING_LUMINANCE = 64.0 / np.pi / 5.0  # cd/m²
_BACKGROUND = 20.0  # % of white's luminance
_REACH = 3.0  # standard deviations on each side that the blur's kernel has


class ExpertScorer:
    """Judges versions of one picture for one observer.

    Args:
        original: (H, W, 3) uint8.
        observer: who looks.
    """

    def __init__(self, original: NDArray[np.uint8], observer: Observer) -> None:
        self._original, self._observer = image_to_tensor(original), observer
        self._lab, self._appearance = srgb_to_lab(self._original), appearance(self._original)

    def score(self, version: NDArray[np.uint8]) -> dict[str, float]:
        """All figures of an (H, W, 3) version.

        Returns:
            ``name_confusions``: see `confused_names`; ``cam_gap``: mean difference in CIECAM02-UCS between what the
            observer sees of the version and what others see of the original; ``cam_change``: the same between version
            and original for others; ``chromatic_difference``: mean distance in CIELAB's a*b* plane of version and
            original; ``ccpr_areas``: see `preserved_areas`.
        """
        changed = image_to_tensor(version)
        seen = self._observer.simulate(changed)
        chroma = (srgb_to_lab(changed) - self._lab)[1:].double()
        return {
            "name_confusions": confused_names(tensor_to_image(self._original), tensor_to_image(seen)),
            "cam_gap": self._distance(seen),
            "cam_change": self._distance(changed),
            "chromatic_difference": float(chroma.square().sum(0).sqrt().mean()),
            "ccpr_areas": preserved_areas(self._original, changed, self._observer),
        }

    def _distance(self, other: Tensor) -> float:
        return float(np.linalg.norm(appearance(other) - self._appearance, axis=-1).mean())


def appearance(image: Tensor) -> NDArray[np.float64]:
    """(H, W, 3) coordinates J'a'b' of CAM02-UCS (Luo, Cui, Li 2006) of a (3, H, W) sRGB image, by colour-science."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Matplotlib.*")  # optional there, and not needed here
        from colour.appearance import XYZ_to_CIECAM02  # here, because it takes a second to import
        from colour.models import JMh_CIECAM02_to_CAM02UCS
    xyz = 100.0 * linear_to_xyz(srgb_to_linear(image.double())).movedim(0, -1).numpy()
    white = 100.0 * RGB_TO_XYZ.sum(1)
    found = XYZ_to_CIECAM02(xyz, white, _ADAPTING_LUMINANCE, _BACKGROUND, compute_H=False)
    correlates = np.stack([np.asarray(found.J), np.asarray(found.M), np.asarray(found.h)], -1)
    return np.asarray(JMh_CIECAM02_to_CAM02UCS(correlates), np.float64)


def preserved_areas(original: Tensor, version: Tensor, observer: Observer) -> float:
    """CCPR of areas: pairs of places `AREA_DISTANCE` apart, across and down, of pictures without their texture.

    Args:
        original, version: (3, H, W) sRGB, for normal vision.
        observer: who sees the version.

    Returns:
        A share in [0, 1]; NaN where no pair differs, or none fits into the picture.
    """
    before = _area_differences(_blurred(original)) >= CCPR_THRESHOLD
    after = _area_differences(observer.simulate(_blurred(version))) >= CCPR_THRESHOLD
    return float(after[before].double().mean())


def _blurred(image: Tensor) -> Tensor:
    size = 2 * round(_REACH * AREA_BLUR) + 1
    linear = srgb_to_linear(image)[None]
    return linear_to_srgb(gaussian_blur2d(linear, (size, size), (AREA_BLUR, AREA_BLUR), border_type="replicate")[0])


def _area_differences(image: Tensor) -> Tensor:
    """(P,) ΔE76 of all pairs."""
    lab, step = srgb_to_lab(image), AREA_DISTANCE
    across = delta_e_76(lab[:, :, step:], lab[:, :, :-step])
    down = delta_e_76(lab[:, step:], lab[:, :-step])
    return torch.cat([across.flatten(), down.flatten()])
