"""Scatters values at colours to the nodes of a three-dimensional table: the transpose of trilinear interpolation."""

from __future__ import annotations

import itertools

from torch import Tensor


def scatter_trilinear(values: Tensor, colors: Tensor, nodes: int) -> Tensor:
    """(B, C, nodes^3) sums at the nodes, red first: each value goes to the eight around its colour.

    The weights are those of trilinear interpolation, and each value's add up to 1.

    Args:
        values: (B, C, P).
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
