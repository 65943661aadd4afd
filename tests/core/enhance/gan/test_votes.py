"""What the pixels vote for moves their own colours, and no others much."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.enhance.gan.votes import Votes
from cvdgs.core.enhance.lut import interpolate

NODES = 9
SHIFT = torch.tensor([0.3, -0.2, 0.1])


def agreeing(*shifts: torch.Tensor) -> Votes:
    """Votes for one shift for each direction, whatever a pixel knows."""
    votes = Votes(4, NODES, len(shifts)).requires_grad_(False)
    votes.layers[-1].weight.zero_()
    votes.layers[-1].bias.copy_(torch.cat([torch.cat([shift, torch.zeros(1)]) for shift in shifts]))
    return votes


def table(votes: Votes, colors: torch.Tensor, share: torch.Tensor | None = None, direction: int = 0) -> torch.Tensor:
    """(N, N, N, 3) of one view whose pixels have (3, H, W) colours; `share` as (H, W), equal where None."""
    torch.manual_seed(1)
    known = torch.rand(1, 4, *colors.shape[1:])
    share = torch.ones(colors.shape[1:]) if share is None else share
    return votes.table(votes.sums(known, colors[None], (share / share.sum())[None, None]), direction)[0]


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))
def test_a_colour_is_shifted_as_its_pixels_vote(values):
    color = torch.tensor(values)
    found = table(agreeing(SHIFT), color[:, None, None].expand(3, 4, 5))
    assert torch.allclose(interpolate(found, color[None, None])[0, 0], 0.1 * SHIFT, atol=2e-3)


def test_colours_that_no_pixel_has_stay():
    found = table(agreeing(SHIFT), torch.full((3, 4, 4), 0.25))
    assert found[2, 2, 2].abs().max() > 0.01
    assert found[4:, 4:, 4:].abs().max() == 0.0


def test_of_two_opinions_about_a_colour_the_mean_is_taken():
    votes = Votes(1, NODES, 1).requires_grad_(False)
    with torch.no_grad():
        votes.layers[0].weight.copy_(torch.ones(32, 1, 1, 1))
        votes.layers[0].bias.zero_()
        votes.layers[-1].weight.zero_()
        votes.layers[-1].weight[0, 0] = 1.0  # the shift of red is what a pixel knows
    known = torch.tensor([[[[1.0, 3.0]]]])
    found = votes.table(votes.sums(known, torch.full((1, 3, 1, 2), 0.5), torch.full((1, 1, 1, 2), 0.5)), 0)
    assert float(found[0, 4, 4, 4, 0]) == pytest.approx(0.2, rel=1e-3)


def test_each_direction_has_its_own_votes():
    votes = agreeing(SHIFT, -2.0 * SHIFT)
    one, other = (table(votes, torch.full((3, 4, 4), 0.5), direction=which) for which in (0, 1))
    assert torch.allclose(other, -2.0 * one, atol=1e-6)


def test_pixels_without_a_share_do_not_vote():
    colors = torch.rand(3, 4, 6, generator=torch.Generator().manual_seed(0))
    share = torch.ones(4, 6)
    share[:, 3:] = 0.0
    votes = agreeing(SHIFT)
    assert torch.allclose(table(votes, colors, share), table(votes, colors[:, :, :3]), atol=1e-6)


def test_the_size_of_a_picture_does_not_matter():
    torch.manual_seed(0)
    votes = Votes(3, NODES, 2).requires_grad_(False)
    colors = torch.rand(1, 3, 4, 5)
    small, large = (
        votes.sums(view, view, torch.full_like(view[:, :1], 1.0 / view[0, 0].numel()))
        for view in (colors, colors.repeat(1, 1, 2, 3))
    )
    assert torch.allclose(small, large, atol=1e-6)
