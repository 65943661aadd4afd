"""What the scene network minimises, on a whole picture.

With d the ΔE76 of two pixels in the original and d' in what the observer sees of the enhanced picture, the terms are,
each a mean over the picture and multiplied by its weight in `ObjectiveWeights`:

- neighbours: of adjacent pixels that are distinct (d >= 6), the share of min(d, 8) that d' lacks. This is CCPR made
  smooth; the hinge ends a little above the threshold, and contrast beyond that is never rewarded.
- areas: the same on the picture at a quarter of its size. Without it, outlines alone would pay.
- distant: for random pairs, the part of min(d, 15) that d' lacks; apart: those of them that are distinct, as for
  neighbours. Without them two parts of a picture that do not touch would come to look alike.
- similarity: 1 - (mean min(d, d') + 1) / (mean d + 1) for pixels 1/40 and 1/10 of the shorter side apart. It is Hu and
  Xiao's measure of discriminability (2026, Eq. 4), stabilised, and holds whole surfaces apart.
- invented: d' beyond max(d, 5) of adjacent pixels that are not distinct: contrast that was not there (CCFR).
- structure: 1 - SSIM of the original and what the observer sees.
- change: a smooth ΔE of the enhanced picture, with the naturalness weight that the fit finds for its budget; skin and
  grey: the same with a fixed weight where a colour is like skin or nearly grey, which people notice first.
- gamut: how far colours leave sRGB before they are clipped.

Pixels that are not covered count for nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from kornia.filters import get_gaussian_kernel1d
from torch import Tensor
from torch.nn import functional

from ...color.metrics import CCPR_THRESHOLD, SSIM_WINDOW
from ...color.protected_colors import skin_likeness
from ...color.simulation import Observer
from ...color.spaces import delta_e_76, delta_e_2000, linear_to_lab, linear_to_srgb, srgb_to_lab, srgb_to_linear

DISTINCT = CCPR_THRESHOLD
"""ΔE76 from which two pixels are distinct."""

_HINGE_END = 8.0  # ΔE76 up to which the contrast of distinct pixels is restored; a reserve over the threshold
_VISIBLE = 5.0  # ΔE76 from which contrast that was not there counts as invented; a reserve below the threshold
_FAR_END = 15.0  # ΔE76 beyond which colours are far apart and need no more
_DISCERNIBLE = 3.0  # ΔE76 from which the contrast of distant pairs counts
_PAIRS = 6000  # random ones
_SURFACES = (1 / 40, 1 / 10)  # distances at which surfaces are compared, as parts of the shorter side
_REDUCTION = 4  # of the copy on which areas are compared
_SURFACE_CELLS = 12  # along the longer side of the copy on which it is counted what is lost of surfaces
_AREA_STEPS = (1, 3)  # pixels of that copy between the areas that are compared
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows and columns to the neighbours of a pixel, each pair once
# Of all pairs, added to the number of distinct ones, so that a picture with hardly any is not ruled by these.
_FEW_NEIGHBOURS, _FEW_AREAS, _FEW_DISTANT = 0.0005, 0.0025, 10 / _PAIRS
_SSIM_SIGMA, _SSIM_C1, _SSIM_C2 = 1.5, 0.01**2, 0.03**2  # Wang et al. 2004
_CHROMA_WEIGHT, _HUE_WEIGHT = 0.045, 0.015  # CIE 116-1995 (CIE94)
_GREY_CHROMA = 5.5  # CIELAB, where a colour is half-way from grey to colourful, over about one unit
# Of coverage or pairs, to divide by where there are none: slopes, which are divided by it too, have to stay finite.
_LEAST_SUM = 1e-9
_JUDGED = 2000  # pixels on which the change is measured as ΔE00, which takes long


@dataclass(frozen=True)
class ObjectiveWeights:
    """Weights of the terms, tuned on five views of the demo, nine photographs and two of Kodak's."""

    neighbours: float = 10.0
    areas: float = 6.0
    distant: float = 6.0
    apart: float = 24.0
    similarity: float = 4.0
    invented: float = 2.0
    structure: float = 4.0
    skin: float = 0.4
    grey: float = 1.2
    gamut: float = 200.0


class Objective:
    """The objective for one picture and one observer.

    Args:
        image: (3, H, W) sRGB in [0, 1], floating point.
        observer: who is to tell things apart.
        coverage: (H, W) in [0, 1]; None where all is covered.
        generator: draws the random pairs.
        weights: of the terms.

    Attributes:
        judged: (J,) some 2,000 of the covered pixels, as flat indices; on these the change is measured.
    """

    def __init__(
        self,
        image: Tensor,
        observer: Observer,
        coverage: Tensor | None = None,
        generator: torch.Generator | None = None,
        weights: ObjectiveWeights = ObjectiveWeights(),
    ) -> None:
        self.image, self.observer, self.weights = image, observer, weights
        self._coverage = torch.ones_like(image[0]) if coverage is None else coverage.to(image.dtype)
        self._covered = self._coverage.sum().clamp(min=_LEAST_SUM)
        self._lab = srgb_to_lab(image)
        self._neighbours = _Pairs(self._lab, _NEIGHBOURS, self._coverage)
        self._areas = _Pairs(
            srgb_to_lab(_reduce(image, _REDUCTION)),
            [offset for step in _AREA_STEPS for offset in ((0, step), (step, 0))],
            _reduce(self._coverage[None], _REDUCTION)[0],
        )
        steps = [max(round(part * min(image.shape[-2:])), 2) for part in _SURFACES]
        self._surfaces = [
            _Pairs(self._lab, [offset], self._coverage) for step in steps for offset in ((0, step), (step, 0))
        ]
        self._distant = _DistantPairs(self._lab, self._coverage, generator)
        self._skin = self._coverage * skin_likeness(image)
        self._grey = self._coverage * torch.sigmoid(_GREY_CHROMA - torch.hypot(self._lab[1], self._lab[2]))
        self._structure = _Structure(image, self._coverage)
        pixels = torch.nonzero(self._coverage.flatten())[:, 0]
        self.judged = pixels[:: max(len(pixels) // _JUDGED, 1)]

    def __call__(
        self, shown: Tensor, naturalness: float, structure: float = 1.0, weights: ObjectiveWeights | None = None
    ) -> Tensor:
        """The weighted sum for a picture before it is clipped.

        Args:
            shown: (3, H, W) sRGB.
            naturalness: weight of the change.
            structure: factor on the weight of that term.
            weights: of the terms; None for the objective's own.
        """
        factors = {**vars(weights or self.weights), "change": naturalness}
        factors["structure"] *= structure
        terms = self.terms(shown)
        return torch.stack([factor * terms[name] for name, factor in factors.items()]).sum()

    def terms(self, shown: Tensor) -> dict[str, Tensor]:
        """The terms without their weights, by name; `shown` as for the call."""
        clipped = shown.clamp(0.0, 1.0)
        linear = srgb_to_linear(clipped)
        seen_linear = self.observer.simulate_linear(linear)
        seen = linear_to_lab(seen_linear)
        near, far = self._neighbours.contrasts(seen), self._distant.contrasts(seen)
        areas = self._areas.contrasts(self.observer.lab(srgb_to_linear(_reduce(clipped, _REDUCTION))))
        change = smooth_change(self._lab, linear_to_lab(linear))
        return {
            "neighbours": self._neighbours.lost(near, _FEW_NEIGHBOURS),
            "areas": self._areas.lost(areas, _FEW_AREAS),
            "distant": self._distant.missing(far),
            "apart": self._distant.lost(far, _FEW_DISTANT),
            "similarity": torch.stack([1.0 - pairs.similarity(seen) for pairs in self._surfaces]).mean(),
            "invented": self._neighbours.invented(near, _FEW_NEIGHBOURS),
            "structure": self._structure.difference(linear_to_srgb(seen_linear)),
            "change": (self._coverage * change).sum() / self._covered,
            "skin": (self._skin * change).sum() / self._covered,
            "grey": (self._grey * change).sum() / self._covered,
            "gamut": (self._coverage * (shown - clipped).square().mean(0)).sum() / self._covered,
        }

    def change(self, shown: Tensor) -> float:
        """Mean ΔE00 of a picture on the judged pixels; `shown` as for the call."""
        return self.change_of(shown.flatten(1)[:, self.judged].T)

    def change_of(self, colors: Tensor) -> float:
        """Mean ΔE00 of the judged pixels from their (J, 3) colours in a picture; 0 where none is judged."""
        if not len(self.judged):
            return 0.0
        original, enhanced = self.image.flatten(1)[:, self.judged, None], colors.detach().T[:, :, None]
        return float(delta_e_2000(original, enhanced.clamp(0.0, 1.0)).mean())


def lost_contrast(image: Tensor, observer: Observer, coverage: Tensor | None = None) -> tuple[float, float]:
    """How many of the distinct pairs in a picture the observer cannot tell apart: of pixels, and of surfaces.

    Surfaces are neighbours on a copy of `_SURFACE_CELLS`. Both shares are 0 where nothing is distinct.

    Args:
        image, observer, coverage: as for `Objective`.
    """
    coverage = torch.ones_like(image[0]) if coverage is None else coverage
    shares = []
    for reduction in (1, max(round(max(image.shape[-2:]) / _SURFACE_CELLS), 1)):
        reduced = _reduce(image, reduction)
        pairs = _Pairs(srgb_to_lab(reduced), _NEIGHBOURS, _reduce(coverage[None], reduction)[0])
        shares.append(pairs.share_lost(observer.lab(srgb_to_linear(reduced))))
    return shares[0], shares[1]


class _Contrasts:
    """The original's ΔE76 of pairs of pixels, (P,), and how much each pair counts."""

    def __init__(self, before: Tensor, weight: Tensor) -> None:
        self._before, self._weight = before, weight
        self._hinge = before.clamp(max=_HINGE_END)
        self._distinct = weight * (before >= DISTINCT)
        self._share = self._distinct / self._hinge.clamp(min=DISTINCT)

    def lost(self, after: Tensor, few: float) -> Tensor:
        """The share of the contrast of distinct pairs that is missing."""
        return (self._share * torch.relu(self._hinge - after)).sum() / self._number(few)

    def invented(self, after: Tensor, few: float) -> Tensor:
        """Contrast of other pairs that was not there, for each distinct pair."""
        beyond = torch.relu(after - self._before.clamp(min=_VISIBLE))
        return ((self._weight - self._distinct) * beyond).sum() / self._number(few)

    def _number(self, few: float) -> Tensor:
        return (self._distinct.sum() + few * self._weight.sum()).clamp(min=_LEAST_SUM)


class _Pairs(_Contrasts):
    """Pairs of pixels at some offsets in (rows, columns); those at which a picture has no pair are left out."""

    def __init__(self, lab: Tensor, offsets: Sequence[tuple[int, int]], coverage: Tensor) -> None:
        height, width = lab.shape[-2:]
        self._offsets = [(down, right) for down, right in offsets if down < height and abs(right) < width]
        weights = [first * second for first, second in (_shifted(coverage, offset) for offset in self._offsets)]
        super().__init__(self.contrasts(lab), _joined(weights, lab))

    def contrasts(self, lab: Tensor) -> Tensor:
        """(P,) ΔE76 of the pairs in a (3, H, W) picture in CIELAB."""
        return _joined([delta_e_76(*_shifted(lab, offset)) for offset in self._offsets], lab)

    def share_lost(self, lab: Tensor) -> float:
        """The share of the distinct pairs that are not distinct in a (3, H, W) picture in CIELAB; 0 without any."""
        lost = (self._distinct * (self.contrasts(lab) < DISTINCT)).sum()
        return float(lost / self._distinct.sum()) if self._distinct.any() else 0.0

    def similarity(self, lab: Tensor) -> Tensor:
        """How alike contrasts up to `_FAR_END` are in a picture and in the original; 1 at most."""
        before = self._before.clamp(max=_FAR_END)
        both = torch.minimum(before, self.contrasts(lab))
        number = self._weight.sum().clamp(min=_LEAST_SUM)
        return ((self._weight * both).sum() / number + 1.0) / ((self._weight * before).sum() / number + 1.0)


class _DistantPairs(_Contrasts):
    """Random pairs of covered pixels."""

    def __init__(self, lab: Tensor, coverage: Tensor, generator: torch.Generator | None) -> None:
        pixels = torch.nonzero(coverage.flatten())[:, 0]
        count = _PAIRS if len(pixels) else 0
        self._pairs = pixels[torch.randint(max(len(pixels), 1), (2, count), generator=generator)]
        before = self.contrasts(lab)
        super().__init__(before, torch.ones_like(before))

    def contrasts(self, lab: Tensor) -> Tensor:
        """(P,) ΔE76 of the pairs in a (3, H, W) picture in CIELAB."""
        first, second = lab.flatten(1)[:, self._pairs, None].unbind(1)
        return delta_e_76(first, second)[:, 0]

    def missing(self, after: Tensor) -> Tensor:
        """The contrast that is missing, relative to what was there."""
        before = self._before.clamp(max=_FAR_END)
        missing = torch.relu(before - after) * (before > _DISCERNIBLE)
        count = max(len(before), 1)
        return (missing.sum() / count) / (before.sum() / count + 1.0)


class _Structure:
    """SSIM against an original whose means and variances are computed once."""

    def __init__(self, image: Tensor, coverage: Tensor) -> None:
        self._image, margin = image, SSIM_WINDOW // 2
        self._kernel = get_gaussian_kernel1d(SSIM_WINDOW, _SSIM_SIGMA, dtype=image.dtype)[0]
        self._is_small = min(image.shape[-2:]) < SSIM_WINDOW
        self._weight = coverage[margin : coverage.shape[0] - margin, margin : coverage.shape[1] - margin]
        if not self._is_small:
            self._mean, square = self._windows(torch.cat([image, image**2])).chunk(2)
            self._variance = square - self._mean**2

    def difference(self, other: Tensor) -> Tensor:
        """1 - the mean SSIM over channels and over windows, by the coverage of their centres; 0 without a window."""
        if self._is_small:
            return other.new_zeros(())
        mean, square, product = self._windows(torch.cat([other, other**2, self._image * other])).chunk(3)
        variance, covariance = square - mean**2, product - self._mean * mean
        similarity = (2.0 * self._mean * mean + _SSIM_C1) * (2.0 * covariance + _SSIM_C2)
        similarity = similarity / ((self._mean**2 + mean**2 + _SSIM_C1) * (self._variance + variance + _SSIM_C2))
        number = self._weight.sum().clamp(min=_LEAST_SUM)
        return (self._weight * (1.0 - similarity.mean(0))).sum() / number

    def _windows(self, maps: Tensor) -> Tensor:
        """Gaussian means of the (C, H, W) maps over all windows that lie inside."""
        count = len(maps)
        kernel = self._kernel.expand(count, 1, 1, -1)
        across = functional.conv2d(maps[None], kernel, groups=count)
        return functional.conv2d(across, kernel.transpose(2, 3), groups=count)[0]


def _shifted(maps: Tensor, offset: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Two views of (..., H, W) maps whose pixels are the pairs at an offset in rows (downwards) and columns."""
    down, right = offset
    height, width = maps.shape[-2:]
    left = max(-right, 0)
    first = maps[..., : height - down, left : width - max(right, 0)]
    return first, maps[..., down:, left + right : width - left if right < 0 else width]


def _joined(maps: Sequence[Tensor], like: Tensor) -> Tensor:
    return torch.cat([one.flatten() for one in maps]) if maps else like.new_zeros(0)


def _reduce(maps: Tensor, reduction: int) -> Tensor:
    """(C, H, W) maps, averaged over squares with sides of `reduction` pixels, or over sides that are shorter."""
    size = [min(reduction, side) for side in maps.shape[-2:]]
    return functional.avg_pool2d(maps[None], size)[0]


def smooth_change(before: Tensor, after: Tensor) -> Tensor:
    """(H, W) change of CIELAB pictures: the CIE94 difference, rounded off at 0 so that its slope is smooth there."""
    difference = after - before
    chroma = (before[1:].square().sum(0) + 1e-3).sqrt()
    chroma_change = (after[1:].square().sum(0) + 1e-3).sqrt() - chroma
    hue_change = (difference[1:].square().sum(0) - chroma_change**2).clamp(min=0.0)
    square = (
        difference[0] ** 2
        + (chroma_change / (1.0 + _CHROMA_WEIGHT * chroma)) ** 2
        + hue_change / (1.0 + _HUE_WEIGHT * chroma) ** 2
    )
    return (square + 1.0).sqrt() - 1.0
