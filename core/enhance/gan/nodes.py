"""Shares what belongs to a colour out to the nodes of a table about it: the transpose of reading the table there."""

from __future__ import annotations

import itertools

from torch import Tensor


def shared_out(values: Tensor, colors: Tensor, nodes: int) -> Tensor:
    """(B, C, nodes^3) sums of (B, C, P) values at the eight nodes around each one's colour, red first.

    The weights are those of trilinear interpolation.

    Args:
        values: what is shared out.
        colors: (B, 3, P) in sRGB; clipped to [0, 1].
        nodes: of the table, along an edge.
    """
    position = colors.clamp(0.0, 1.0) * (nodes - 1)
    lower = position.floor().clamp(max=nodes - 2)
    fraction, lower = position - lower, lower.long()
    sums = values.new_zeros(*values.shape[:2], nodes**3)
    for corner in itertools.product((0, 1), repeat=3):
        upper = lower.new_tensor(corner)[:, None]
        weight = (fraction * upper + (1.0 - fraction) * (1 - upper)).prod(1, keepdim=True)
        red, green, blue = (lower + upper).unbind(1)
        node = (red * nodes + green) * nodes + blue
        sums = sums.scatter_add(2, node[:, None].expand_as(values), weight * values)
    return sums
