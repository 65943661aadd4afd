"""The adversaries want opposite things."""

from __future__ import annotations

import torch

from cvdgs.scripts.training.gan.losses import discriminator_loss, generator_loss


def test_the_adversaries_want_opposite_things():
    high, low = torch.full((1, 1, 4, 4), 3.0), torch.full((1, 1, 4, 4), -3.0)
    assert generator_loss(high) < generator_loss(low)
    assert discriminator_loss(high, low) < discriminator_loss(low, high)
