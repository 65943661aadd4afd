"""How the enhancer is trained: a try-out of minutes, what two processor cores manage in an hour or two, and a GPU's."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.enhance.gan.networks import GeneratorConfig
from .gan.training import TrainingSettings


@dataclass(frozen=True)
class Preset:
    """A training run's size.

    Attributes:
        samples: images in the paired dataset.
        size: their sides in pixels.
        settings: of the training.
    """

    samples: int
    size: int
    settings: TrainingSettings


PRESETS = {
    "small": Preset(
        samples=24,
        size=96,
        settings=TrainingSettings(
            steps=150,
            crop=64,
            discriminator_width=8,
            average_decay=0.98,
            generator=GeneratorConfig(widths=(8, 12, 16, 24), embedding=16),
        ),
    ),
    "cpu": Preset(samples=638, size=288, settings=TrainingSettings()),
    # Meant for twenty minutes of an H200 by counting operations (40 GMAC a megapixel in the generator, 53 in the
    # discriminator, for one pass); not measured.
    "full": Preset(
        samples=6000,
        size=288,
        settings=TrainingSettings(
            steps=30_000,
            batch=16,
            crop=256,
            discriminator_width=64,
            generator=GeneratorConfig(widths=(32, 48, 64, 128, 192, 256)),
        ),
    ),
}
"""By name."""
