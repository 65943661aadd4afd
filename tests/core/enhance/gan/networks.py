"""Generators whose weights are random everywhere, so that every path through them shows."""

from __future__ import annotations

import torch

from cvdgs.core.enhance.gan.networks import Generator, GeneratorConfig

SMALL = GeneratorConfig(widths=(6, 8, 12, 16), embedding=12)


def random_generator(config: GeneratorConfig = SMALL, seed: int = 0) -> Generator:
    """A generator that changes colours visibly, differently from place to place and by observer and palette."""
    torch.manual_seed(seed)
    generator = Generator(config).eval().requires_grad_(False)
    for name, value in generator.named_parameters():
        if "modulate" in name or name.startswith("residual"):
            value.normal_(std=0.2)
    return generator
