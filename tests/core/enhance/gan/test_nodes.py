"""What is shared out to a table's nodes is all of it, and as reading the table at the colours would have it."""

from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.enhance.gan.nodes import scatter_trilinear
from cvdgs.core.enhance.lut import interpolate

COLORS = st.lists(st.tuples(*3 * [st.floats(0.0, 1.0)]), min_size=1, max_size=20)


@given(COLORS, st.integers(2, 9))
def test_nothing_is_lost(colors, nodes):
    torch.manual_seed(0)
    values = torch.rand(1, 2, len(colors), dtype=torch.float64)
    sums = scatter_trilinear(values, torch.tensor(colors, dtype=torch.float64).T[None], nodes)
    assert torch.allclose(sums.sum(2), values.sum(2))


@given(COLORS, st.integers(2, 9))
def test_sharing_out_is_the_transpose_of_interpolation(colors, nodes):
    colors = torch.tensor(colors)
    torch.manual_seed(0)
    values, table = torch.rand(1, 3, len(colors)), torch.rand(nodes, nodes, nodes, 3)
    read = interpolate(table, colors[None])[0]
    sums = scatter_trilinear(values, colors.T[None], nodes)[0]
    assert torch.allclose((sums.T.reshape(table.shape) * table).sum(), (values[0].T * read).sum(), rtol=1e-4)


def test_a_nodes_own_colour_goes_to_it_alone():
    sums = scatter_trilinear(torch.ones(1, 1, 1), torch.tensor([[[1.0], [0.0], [0.5]]]), 3)
    assert sums[0, 0].nonzero().tolist() == [[(2 * 3 + 0) * 3 + 1]]
