"""The losses of the seed's Eq. 5: adversarial, contrast under the simulation, and distance to the teacher."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

STABILISER = 4.0
"""ΔE76², added to both sides of the similarity: contrasts below ΔE 2 are nobody's to preserve, and 0/0 becomes 1."""


def contrast_distance(original_lab: Tensor, seen_lab: Tensor, windows: Sequence[int], one_sided: bool = True) -> Tensor:
    """L_cd: 1 - similarity of the local contrasts of the original and of what the observer sees; a scalar in [0, 1].

    The contrast σ of a window is the standard deviation of its colours in CIELAB (the root of the summed variances of
    L*, a* and b*), so contrast of chroma may come back as contrast of luminance: an edge between isoluminant colours
    counts. The similarity is that of SSIM's contrast term, (2 σ σ' + C) / (σ² + σ'² + C).

    Args:
        original_lab, seen_lab: (B, 3, H, W) CIELAB of the original and of S(candidate).
        windows: sides of the windows in pixels; the loss is averaged over them. They overlap by half.
        one_sided: whether contrast beyond the original's counts as similar; else it counts as a difference.
    """
    losses = []
    for window in windows:
        before, after = _contrast(original_lab, window), _contrast(seen_lab, window)
        if one_sided:
            after = torch.minimum(before, after)
        similarity = (2.0 * before * after + STABILISER) / (before**2 + after**2 + STABILISER)
        losses.append((1.0 - similarity).mean())
    return torch.stack(losses).mean()


def _contrast(lab: Tensor, window: int) -> Tensor:
    """(B, H', W') standard deviation of colours in windows."""
    window = min(window, *lab.shape[-2:])
    step = max(window // 2, 1)
    # Differences to the image's mean keep E[x²] - E[x]² from cancelling in float32.
    centred = lab - lab.mean((-2, -1), keepdim=True)
    mean = functional.avg_pool2d(centred, window, step)
    variance = (functional.avg_pool2d(centred**2, window, step) - mean**2).sum(1)
    # The bound keeps the root's slope finite where a window is flat: a contrast of ΔE 0.1.
    return variance.clamp(min=0.01).sqrt()


def generator_loss(judged: Tensor) -> Tensor:
    """L_GAN for the generator: its output should pass for the teacher's."""
    return functional.binary_cross_entropy_with_logits(judged, torch.ones_like(judged))


def discriminator_loss(judged_real: Tensor, judged_fake: Tensor) -> Tensor:
    """L_GAN for the discriminator, halved as in pix2pix to slow it down."""
    real = functional.binary_cross_entropy_with_logits(judged_real, torch.ones_like(judged_real))
    fake = functional.binary_cross_entropy_with_logits(judged_fake, torch.zeros_like(judged_fake))
    return (real + fake) / 2.0
