"""The discriminator: a PatchGAN that tells the teacher's recolouring from the generator's, patch by patch."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from .conditioning import OBSERVER_FEATURES
from .generator import channels_last

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
