"""The discriminator judges patches of 70 pixels."""

from __future__ import annotations

import torch
from torch import nn

from cvdgs.core.enhance.gan.conditioning import OBSERVER_FEATURES
from cvdgs.scripts.training.gan.losses import PATCH_SIZE, Discriminator


def test_one_output_sees_seventy_pixels():
    torch.manual_seed(0)
    discriminator = Discriminator(4).double()
    for module in discriminator.modules():
        if isinstance(module, nn.InstanceNorm2d):
            module.forward = lambda features: features  # its statistics reach everywhere
    image = torch.rand(1, 3, 160, 160, dtype=torch.float64, requires_grad=True)
    judged = discriminator(image.detach(), image, torch.zeros(1, OBSERVER_FEATURES, dtype=torch.float64))
    judged[0, 0, judged.shape[2] // 2, judged.shape[3] // 2].backward()
    rows, columns = torch.nonzero(image.grad[0].abs().sum(0), as_tuple=True)
    assert int(rows.max() - rows.min()) + 1 == PATCH_SIZE
    assert int(columns.max() - columns.min()) + 1 == PATCH_SIZE
