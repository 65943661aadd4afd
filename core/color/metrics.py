"""Image metrics: contrast preservation under a deficiency (CCPR and its relatives) and closeness to the original.

Images are (3, H, W) sRGB tensors in [0, 1]. A mask, (H, W) bool, restricts a metric to covered pixels; a pair of pixels
counts if both are covered. A metric that cannot be computed (no pair, no pixel) is NaN, never a perfect score.

CCPR and CCFR follow Lu, Xu and Jia, "Contrast preserving decolorization" (2012; IJCV 2014), with ΔE76 between
8-neighbours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from kornia.metrics import ssim as ssim_map
from torch import Tensor

from .spaces import delta_e_76, delta_e_2000, linear_to_srgb, srgb_to_lab, srgb_to_linear

CCPR_THRESHOLD = 6.0
"""ΔE76 from which two neighbours count as distinct in headline figures."""

CCPR_MEAN_THRESHOLDS = tuple(float(tau) for tau in range(1, 16))
"""ΔE76 thresholds of the averaged CCPR."""

GLOBAL_PAIRS = 200_000
"""Random pixel pairs of the global CCPR."""

SSIM_WINDOW = 11
"""Pixels; kornia's Gaussian has a standard deviation of 1.5 (Wang et al. 2004)."""


@dataclass(frozen=True)
class ContrastScores:
    """How well the contrasts of an image survive in its simulation. Ratios in [0, 1]; NaN where no pair is distinct.

    Attributes:
        ccpr: share of neighbour pairs distinct in the original that are distinct in the simulation.
        pairs: |Ω|, the number of neighbour pairs distinct in the original.
        ccpr_mean: CCPR averaged over `CCPR_MEAN_THRESHOLDS`.
        ccpr_global: CCPR over random pairs of pixels anywhere in the image.
        ccfr: share of neighbour pairs distinct in the simulation that are distinct in the original; the rest is
            invented contrast.
    """

    ccpr: float
    pairs: int
    ccpr_mean: float
    ccpr_global: float
    ccfr: float


@dataclass(frozen=True)
class Naturalness:
    """How close an enhanced image stays to the original for normal vision; `delta_e_*` are means over pixels."""

    ssim: float
    psnr: float
    delta_e_76: float
    delta_e_2000: float


def contrast_scores(
    original: Tensor,
    simulated: Tensor,
    threshold: float = CCPR_THRESHOLD,
    *,
    mask: Tensor | None = None,
    global_pairs: int = GLOBAL_PAIRS,
    seed: int = 0,
) -> ContrastScores:
    """All contrast metrics of one image.

    Args:
        original: what normal vision sees.
        simulated: S(candidate), clipped, of the enhanced or rendered image, or of the original itself.
        threshold: τ, the ΔE76 from which a pair is distinct.
        mask: (H, W) bool, the pixels that count.
        global_pairs, seed: number of random pairs for the global CCPR, and their seed.
    """
    before_lab, after_lab = srgb_to_lab(original), srgb_to_lab(simulated)
    before, after = _neighbour_differences(before_lab, mask), _neighbour_differences(after_lab, mask)
    distinct, still = before >= threshold, after >= threshold
    both, pairs = int((distinct & still).sum()), int(distinct.sum())
    return ContrastScores(
        ccpr=_share(both, pairs),
        pairs=pairs,
        ccpr_mean=_mean_preserved(before, after),
        ccpr_global=_global_preserved(before_lab, after_lab, threshold, mask, global_pairs, seed),
        ccfr=_share(both, int(still.sum())),
    )


def ccpr(
    original: Tensor, simulated: Tensor, threshold: float = CCPR_THRESHOLD, *, mask: Tensor | None = None
) -> tuple[float, int]:
    """CCPR(τ) and |Ω| alone, see `ContrastScores`; about three times as fast as `contrast_scores`."""
    both, pairs, _ = _distinct_pairs(original, simulated, threshold, mask)
    return _share(both, pairs), pairs


def ccpr_and_ccfr(
    original: Tensor, simulated: Tensor, threshold: float = CCPR_THRESHOLD, *, mask: Tensor | None = None
) -> tuple[float, float]:
    """CCPR(τ) and CCFR(τ) alone, see `ContrastScores`."""
    both, before, after = _distinct_pairs(original, simulated, threshold, mask)
    return _share(both, before), _share(both, after)


def half_size(image: Tensor) -> Tensor:
    """A (3, H, W) sRGB image at half its size, averaged in linear light over 2×2 pixels; an odd edge is left out.

    Neighbouring pixels are the finest texture only. From twice as far away, or on half as many pixels, people see this.
    """
    return linear_to_srgb(torch.nn.functional.avg_pool2d(srgb_to_linear(image)[None], 2)[0])


def half_size_mask(mask: Tensor) -> Tensor:
    """An (H, W) mask at half its size: a pixel is covered if all four that it stands for are."""
    return torch.nn.functional.avg_pool2d(mask[None].double(), 2)[0] == 1.0


def ssim(first: Tensor, second: Tensor, *, mask: Tensor | None = None) -> float:
    """Mean SSIM over RGB and over all windows inside the image, or those centred on a covered pixel.

    NaN if the image is smaller than the 11-pixel window.
    """
    if min(first.shape[-2:]) < SSIM_WINDOW:
        return math.nan
    similarity = ssim_map(first[None], second[None], SSIM_WINDOW, padding="valid")[0].mean(0)
    margin = SSIM_WINDOW // 2
    inner = None if mask is None else mask[margin:-margin, margin:-margin]
    return _mean(similarity, inner)


def psnr(first: Tensor, second: Tensor, *, mask: Tensor | None = None) -> float:
    """Peak signal-to-noise ratio in dB over all channels, peak 1; infinite for identical images."""
    error = _mean(((first - second).double() ** 2).mean(0), mask)
    if error == 0.0:
        return math.inf
    return -10.0 * math.log10(error)


def naturalness(original: Tensor, enhanced: Tensor, *, mask: Tensor | None = None) -> Naturalness:
    """How close `enhanced` stays to `original`."""
    return Naturalness(
        ssim=ssim(original, enhanced, mask=mask),
        psnr=psnr(original, enhanced, mask=mask),
        delta_e_76=_mean(delta_e_76(srgb_to_lab(original), srgb_to_lab(enhanced)), mask),
        delta_e_2000=_mean(delta_e_2000(original, enhanced), mask),
    )


def _distinct_pairs(original: Tensor, simulated: Tensor, threshold: float, mask: Tensor | None) -> tuple[int, int, int]:
    """Numbers of neighbour pairs that are distinct in both images, in the original, and in the simulation."""
    before, after = (_neighbour_differences(srgb_to_lab(x), mask) >= threshold for x in (original, simulated))
    return int((before & after).sum()), int(before.sum()), int(after.sum())


def _neighbour_differences(lab: Tensor, mask: Tensor | None) -> Tensor:
    """(P,) ΔE76 of all 8-neighbour pairs, each once: right, below, and the two diagonals."""
    pairs = neighbour_pairs(lab)
    differences = torch.cat([delta_e_76(first, second).flatten() for first, second in pairs])
    if mask is None:
        return differences
    covered = torch.cat([(first & second).flatten() for first, second in neighbour_pairs(mask)])
    return differences[covered]


def neighbour_pairs(image: Tensor) -> list[tuple[Tensor, Tensor]]:
    """The pixels of (..., H, W) beside their right, lower, lower right and lower left neighbours: each pair once."""
    return [
        (image[..., :, 1:], image[..., :, :-1]),
        (image[..., 1:, :], image[..., :-1, :]),
        (image[..., 1:, 1:], image[..., :-1, :-1]),
        (image[..., 1:, :-1], image[..., :-1, 1:]),
    ]


def _mean_preserved(before: Tensor, after: Tensor) -> float:
    """CCPR averaged over `CCPR_MEAN_THRESHOLDS`, without thresholds that no pair reaches."""
    # A pair is preserved at τ if min(before, after) >= τ, so two cumulative histograms over whole τ serve every τ.
    top = len(CCPR_MEAN_THRESHOLDS)
    distinct, preserved = (
        torch.bincount(values.clamp(max=top).to(torch.int32), minlength=top + 1).flip(0).cumsum(0).flip(0)[1:]
        for values in (before, torch.minimum(before, after))
    )
    present = distinct > 0
    return float((preserved[present] / distinct[present]).double().mean())


def _global_preserved(
    before_lab: Tensor, after_lab: Tensor, threshold: float, mask: Tensor | None, pairs: int, seed: int
) -> float:
    before_lab, after_lab = before_lab.flatten(-2), after_lab.flatten(-2)
    if mask is not None:
        before_lab, after_lab = before_lab[:, mask.flatten()], after_lab[:, mask.flatten()]
    count = before_lab.shape[-1]
    if count == 0:
        return math.nan
    generator = torch.Generator().manual_seed(seed)
    first, second = torch.randint(count, (2, pairs), generator=generator).to(before_lab.device)
    before = delta_e_76(before_lab[:, first, None], before_lab[:, second, None])
    after = delta_e_76(after_lab[:, first, None], after_lab[:, second, None])
    distinct = before >= threshold
    return _share(int((distinct & (after >= threshold)).sum()), int(distinct.sum()))


def _share(part: int, whole: int) -> float:
    return part / whole if whole else math.nan


def _mean(values: Tensor, mask: Tensor | None) -> float:
    """Mean over the covered pixels of an (H, W) map; NaN if there are none."""
    return float((values if mask is None else values[mask]).double().mean())
