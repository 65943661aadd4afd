"""The losses of Hu and Xiao (2026), Eq. 5: contrast under the simulation, adversarial, and its discriminator."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from kornia.metrics import ssim as ssim_map
from torch import Tensor, nn
from torch.nn import functional

from ....core.color.metrics import SSIM_WINDOW
from ....core.enhance.gan.conditioning import OBSERVER_FEATURES
from ....core.enhance.gan.networks import channels_last

STABILISER = 1.0
"""ΔE76, added to the mean contrasts on both sides of the similarity: 0/0 becomes 1, and faint noise hardly counts."""

CONTRAST_CAP = 15.0
"""ΔE76 beyond which a contrast is as good as any: the largest threshold of the averaged CCPR."""

_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))  # of the 8-neighbours, each pair once


def contrast_distance(
    original_lab: Tensor, seen_lab: Tensor, offsets: Sequence[int] = (1,), one_sided: bool = True
) -> Tensor:
    """1 - similarity of the contrasts of the original and of what the observer sees; a scalar in [0, 1].

    A contrast is the ΔE76 of a pair of pixels, so contrast of chroma may come back as contrast of luminance. With d in
    the original, capped at `CONTRAST_CAP`, and d' as seen, the similarity is (Σ min(d, d') + C) / (Σ d + C). Averaged
    over thresholds up to the cap, the share of pairs that stay distinct is just that (with C = 0), so this is 1 - CCPR
    made differentiable.

    Args:
        original_lab, seen_lab: (B, 3, H, W) CIELAB of the original and of S(candidate).
        offsets: distances of the pairs in pixels; the loss is averaged over them. Neighbours alone could be told
            apart by outlines; pairs further apart ask that areas differ.
        one_sided: whether contrast beyond the original's counts as similar; else the denominator is Σ max(d, d').
    """
    losses = []
    for offset in offsets:
        before = torch.cat([_differences(original_lab, offset, direction) for direction in _DIRECTIONS], 1)
        after = torch.cat([_differences(seen_lab, offset, direction) for direction in _DIRECTIONS], 1)
        before = before.clamp(max=CONTRAST_CAP)
        whole = before if one_sided else torch.maximum(before, after)
        kept = torch.minimum(before, after)
        losses.append(1.0 - ((kept.mean(1) + STABILISER) / (whole.mean(1) + STABILISER)).mean())
    return torch.stack(losses).mean()


def _differences(lab: Tensor, offset: int, direction: tuple[int, int]) -> Tensor:
    """(B, P) ΔE76 of all pairs of pixels of an image that lie so far apart in a direction."""
    height, width = lab.shape[-2:]
    down, right = (step * min(offset, side - 1) for step, side in zip(direction, (height, width), strict=True))
    first = lab[..., : height - down, max(-right, 0) : width - max(right, 0)]
    second = lab[..., down:, max(right, 0) : width + min(right, 0)]
    # The bound keeps the root's slope finite where two pixels are equal: ΔE 0.1.
    return (first - second).square().sum(1).clamp(min=0.01).sqrt().flatten(1)


def structure_distance(original: Tensor, seen: Tensor) -> Tensor:
    """1 - mean SSIM of the original and of what the observer sees, over RGB; a scalar in [0, 2].

    Together with `contrast_distance`, whose similarity has no sign, this is L_cd over luminance and chroma: it asks
    that structure comes back the right way round, and in the channels it was in.

    Args:
        original, seen: (B, 3, H, W) sRGB.
    """
    return 1.0 - ssim_map(original, seen, SSIM_WINDOW).mean()


def generator_loss(judged: Tensor) -> Tensor:
    """L_GAN for the generator: its output should pass for the teacher's."""
    return functional.binary_cross_entropy_with_logits(judged, torch.ones_like(judged))


def discriminator_loss(judged_real: Tensor, judged_fake: Tensor) -> Tensor:
    """L_GAN for the discriminator, halved as in pix2pix to slow it down."""
    real = functional.binary_cross_entropy_with_logits(judged_real, torch.ones_like(judged_real))
    fake = functional.binary_cross_entropy_with_logits(judged_fake, torch.zeros_like(judged_fake))
    return (real + fake) / 2.0


PATCH_SIZE = 70
"""Sides of the patch that one output judges, in pixels: 4×4 kernels of strides 2, 2, 2, 1, 1 (Isola et al. 2017)."""


class Discriminator(nn.Module):
    """The 70×70 PatchGAN of pix2pix on (input, output), told the observer as constant planes.

    Args:
        width: channels of the first layer; 64 in pix2pix.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(6 + OBSERVER_FEATURES, width, 4, stride=2, padding=1),
            nn.LeakyReLU(0.2),
            *_block(width, 2 * width, 2),
            *_block(2 * width, 4 * width, 2),
            *_block(4 * width, 8 * width, 1),
            nn.Conv2d(8 * width, 1, 4, stride=1, padding=1),
        )
        channels_last(self)

    def forward(self, original: Tensor, candidate: Tensor, observer: Tensor) -> Tensor:
        """(B, 1, H', W') logits, positive for the teacher's work.

        Args:
            original, candidate: (B, 3, H, W) sRGB in [0, 1], at least 32 pixels a side.
            observer: (B, OBSERVER_FEATURES).
        """
        planes = observer[:, :, None, None].expand(-1, -1, *original.shape[-2:])
        pair = torch.cat([original - 0.5, candidate - 0.5, planes], 1)
        return self.layers(pair.contiguous(memory_format=torch.channels_last))


def _block(before: int, after: int, stride: int) -> tuple[nn.Module, ...]:
    return (
        nn.Conv2d(before, after, 4, stride=stride, padding=1),
        nn.InstanceNorm2d(after, affine=True),
        nn.LeakyReLU(0.2),
    )
