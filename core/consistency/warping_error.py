"""How much views contradict each other: the relative warping error (RWE) and its companions.

The ratio is taken between sums over all visible correspondences, not pixel by pixel: a mean of per-pixel ratios is
dominated by pixels whose original difference happens to be nearly zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .correspondence import Correspondences, sample_bilinear


@dataclass(frozen=True)
class WarpingError:
    """Disagreement of an image set over correspondences; NaN if there are none or the originals agree exactly.

    Attributes:
        ratio: Σ|Î_i - Î_j|₁ / Σ|I_i - I_j|₁ of enhanced Î and original I; 1 means that enhancement added nothing.
        absolute: mean |Î_i - Î_j| per pixel and channel, of values in [0, 1].
        absolute_original: the same of the originals.
        e_warp: Lai et al. 2018, "Learning blind video temporal consistency": mean squared distance of the colours over
            a view pair's correspondences, averaged over view pairs.
        e_warp_original: the same of the originals.
        normalised_ratio: `ratio` with each difference divided by the standard deviation of its own view pair, so that
            an image set does not gain by losing contrast.
        correspondences: number of pixel correspondences.
        view_pairs: number of view pairs that have any.
    """

    ratio: float
    absolute: float
    absolute_original: float
    e_warp: float
    e_warp_original: float
    normalised_ratio: float
    correspondences: int
    view_pairs: int


@dataclass(frozen=True)
class _PairSums:
    """One view pair's sums over its correspondences, and the standard deviation of its two images."""

    absolute: float
    squared: float
    deviation: float


def relative_warping_error(
    originals: Sequence[NDArray], enhanced: Sequence[NDArray], correspondences: Sequence[Correspondences]
) -> WarpingError:
    """Warping error of the enhanced images relative to the originals.

    Args:
        originals, enhanced: (H, W, 3) per view, uint8 or float in [0, 1], by the indices of the correspondences.
        correspondences: of pairs of these views.
    """
    used = [pair for pair in correspondences if len(pair)]
    before = [_sums(originals, pair) for pair in used]
    after = [_sums(enhanced, pair) for pair in used]
    counts = [len(pair) for pair in used]
    total = sum(counts)
    channels = originals[0].shape[-1] if len(originals) else 0
    return WarpingError(
        ratio=_quotient(sum(s.absolute for s in after), sum(s.absolute for s in before)),
        absolute=_quotient(sum(s.absolute for s in after), total * channels),
        absolute_original=_quotient(sum(s.absolute for s in before), total * channels),
        e_warp=_quotient(sum(s.squared / n for s, n in zip(after, counts, strict=True)), len(used)),
        e_warp_original=_quotient(sum(s.squared / n for s, n in zip(before, counts, strict=True)), len(used)),
        normalised_ratio=_quotient(
            sum(_quotient(s.absolute, s.deviation) for s in after),
            sum(_quotient(s.absolute, s.deviation) for s in before),
        ),
        correspondences=total,
        view_pairs=len(used),
    )


def _sums(images: Sequence[NDArray], pair: Correspondences) -> _PairSums:
    first, second = _unit(images[pair.first]), _unit(images[pair.second])
    seen = first.reshape(-1, first.shape[-1])[pair.first_pixels]
    difference = (seen - sample_bilinear(second, pair.second_positions)).astype(np.float64)
    return _PairSums(
        absolute=float(np.abs(difference).sum()),
        squared=float((difference**2).sum()),
        deviation=math.sqrt((float(first.var(dtype=np.float64)) + float(second.var(dtype=np.float64))) / 2.0),
    )


def _unit(image: NDArray) -> NDArray[np.float32]:
    values = np.asarray(image, np.float32)
    return values / np.float32(255.0) if image.dtype == np.uint8 else values


def _quotient(numerator: float, denominator: float) -> float:
    return numerator / denominator if denominator else math.nan
