"""Generators whose weights are random everywhere, so that every path through them shows."""

from __future__ import annotations

import torch

from cvdgs.core.enhance.gan.networks import Generator, GeneratorConfig

SMALL = GeneratorConfig(widths=(4, 6, 8, 8), attentions=3, embedding=8, code=6)


def random_generator(config: GeneratorConfig = SMALL, seed: int = 0) -> Generator:
    """A generator that predicts visibly different networks for different scenes and observers."""
    torch.manual_seed(seed)
    generator = Generator(config).eval().requires_grad_(False)
    generator.parameters_of.weight.normal_(std=0.5)
    generator.share.weight.normal_(std=0.5)
    generator.rates.normal_(-4.0, 0.5)
    generator.votes.layers[-1].weight.normal_(std=0.5)
    return generator
