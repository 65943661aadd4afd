"""The adversary: a PatchGAN that judges (photograph, shown) pairs, and the losses of both sides."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from ....core.enhance.gan.conditioning import OBSERVER_FEATURES

PATCH_SIZE = 70
"""Sides of the patch that one output judges, in pixels: 4×4 kernels of strides 2, 2, 2, 1, 1 (Isola et al. 2017)."""


def generator_loss(judged: Tensor) -> Tensor:
    """L_GAN for the generator: what it shows should pass for what a fitted network shows."""
    return functional.binary_cross_entropy_with_logits(judged, torch.ones_like(judged))


def discriminator_loss(judged_real: Tensor, judged_fake: Tensor) -> Tensor:
    """L_GAN for the discriminator, halved as in pix2pix to slow it down."""
    real = functional.binary_cross_entropy_with_logits(judged_real, torch.ones_like(judged_real))
    fake = functional.binary_cross_entropy_with_logits(judged_fake, torch.zeros_like(judged_fake))
    return (real + fake) / 2.0


class Discriminator(nn.Module):
    """The 70×70 PatchGAN of pix2pix on (photograph, shown), told the observer as constant planes.

    Args:
        width: channels of the first layer; 64 in pix2pix.
    """

    def __init__(self, width: int = 16) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(6 + OBSERVER_FEATURES, width, 4, stride=2, padding=1),
            nn.LeakyReLU(0.2),
            *_block(width, 2 * width, 2),
            *_block(2 * width, 4 * width, 2),
            *_block(4 * width, 8 * width, 1),
            nn.Conv2d(8 * width, 1, 4, stride=1, padding=1),
        )

    def forward(self, photograph: Tensor, shown: Tensor, observer: Tensor) -> Tensor:
        """(B, 1, H', W') logits, positive for what a fitted network shows.

        Args:
            photograph, shown: (B, 3, H, W) sRGB in [0, 1], at least 32 pixels a side.
            observer: (B, OBSERVER_FEATURES).
        """
        planes = observer[:, :, None, None].expand(-1, -1, *photograph.shape[-2:])
        return self.layers(torch.cat([photograph - 0.5, shown - 0.5, planes], 1))


def _block(before: int, after: int, stride: int) -> tuple[nn.Module, ...]:
    return (
        nn.Conv2d(before, after, 4, stride=stride, padding=1),
        nn.InstanceNorm2d(after, affine=True),
        nn.LeakyReLU(0.2),
    )
