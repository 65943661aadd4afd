"""Votes on a table of colours: each pixel says how its own colour is to be shifted, and how far it is to be trusted."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from .nodes import scatter_trilinear

SLOPE = 0.2
"""Of the generator's leaky ReLUs, as in pix2pix."""

_HIDDEN = 32  # channels between what a pixel knows and its votes
_FIRST_SCALE = 0.3  # of the layer that gives the votes, at first
_SHIFT_SCALE = 0.1  # sRGB units of a vote of 1
_SPREAD = 0.1  # part of its votes that a node passes to each next one, along every axis
_FEW = 1e-4  # of all pixels: a node that fewer vote for moves less


class Votes(nn.Module):
    """Shifts of colours, as means of what the pixels vote for; one table for each direction.

    Args:
        channels: of what a pixel knows.
        nodes: N, a side of the table.
        directions: tables.
    """

    def __init__(self, channels: int, nodes: int, directions: int) -> None:
        super().__init__()
        self._nodes, self._directions = nodes, directions
        first, last = nn.Conv2d(channels, _HIDDEN, 1), nn.Conv2d(_HIDDEN, 4 * directions, 1)
        self.layers = nn.Sequential(first, nn.LeakyReLU(SLOPE), last)
        with torch.no_grad():
            for name, values in last.named_parameters():
                values.mul_(_FIRST_SCALE if name == "weight" else 0.0)

    @property
    def size(self) -> int:
        """Numbers in the sums of one view."""
        return 4 * self._directions * self._nodes**3

    def sums(self, known: Tensor, colors: Tensor, share: Tensor) -> Tensor:
        """(V, `size`) the trusted shifts and the trust that come to each node; views are averaged by their mean.

        Args:
            known: (V, C, H, W) what each pixel knows.
            colors: (V, 3, H, W) its colour in sRGB.
            share: (V, 1, H, W) its part of the view; adds up to 1.
        """
        votes = self.layers(known).unflatten(1, (self._directions, 4)).flatten(3)
        trust = torch.sigmoid(votes[:, :, 3:]) * share.flatten(2)[:, None]
        trusted = torch.cat([trust * votes[:, :, :3], trust], 2).flatten(1, 2)
        return scatter_trilinear(trusted, colors.flatten(2), self._nodes).flatten(1)

    def table(self, sums: Tensor, direction: int) -> Tensor:
        """(B, N, N, N, 3) shifts in sRGB.

        Args:
            sums: (B, `size`) mean `sums` of each scene's views.
            direction: which of the tables.
        """
        sums = sums.reshape(len(sums), self._directions, 4, *3 * [self._nodes])[:, direction]
        along = sums.new_tensor([_SPREAD, 1.0, _SPREAD])
        kernel = along[:, None, None] * along[:, None] * along
        sums = functional.conv3d(sums, kernel.expand(4, 1, 3, 3, 3), padding=1, groups=4)
        return _SHIFT_SCALE * (sums[:, :3] / (sums[:, 3:] + _FEW)).permute(0, 2, 3, 4, 1)
