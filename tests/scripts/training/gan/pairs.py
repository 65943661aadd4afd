"""A paired dataset without files: stripes that a deutan confuses, and their recolouring by a fixed rule."""

from __future__ import annotations

import numpy as np

from cvdgs.scripts.training.data.dataset import Sample

OBSERVERS = (("deutan", 1.0, "machado"), ("protan", 0.6, "machado"))


class StripedPairs:
    """Red and green stripes of random shades; the target shifts red to a darker and green to a lighter shade."""

    def __init__(self, count: int, size: int = 64) -> None:
        self._count, self._size = count, size

    def __len__(self) -> int:
        return self._count

    def sample(self, index: int) -> Sample:
        generator = np.random.default_rng(index)
        image = np.empty((self._size, self._size, 3), np.uint8)
        period = int(generator.integers(4, 9))
        red = (np.arange(self._size) // period) % 2 == 0
        image[:, red] = generator.integers((170, 80, 60), (190, 100, 80))
        image[:, ~red] = generator.integers((100, 120, 60), (120, 140, 80))
        target = image.astype(np.int16)
        target[:, red] -= 30
        target[:, ~red] += 30
        targets = np.stack([target.clip(0, 255).astype(np.uint8)] * len(OBSERVERS))
        return Sample(image, targets, OBSERVERS, "stripes")
