"""Training examples in memory, the batches of crops that are drawn from them, and their observers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ....core.color.matrices import LinearSimulation, linear_simulation
from ....core.color.simulation import Observer
from ....core.color.spaces import linear_to_srgb, srgb_to_linear
from ....core.enhance.gan.conditioning import observer_features, palette
from ....core.runtime.protocol import Reporter
from ..data.dataset import PairedDataset


@dataclass(frozen=True)
class Batch:
    """B crops, each for an observer of its own; images are (B, 3, H, W) sRGB in [0, 1].

    Attributes:
        original: the inputs.
        target: what the teacher made of them.
        palettes: (B, PALETTE_FEATURES) of the whole images that the crops are from.
        observers: B of them.
    """

    original: Tensor
    target: Tensor
    palettes: Tensor
    observers: list[Observer]

    def split(self, parts: int) -> list[Batch]:
        """The batch in so many parts of the same size."""
        size = len(self.observers) // parts
        ranges = [slice(first, first + size) for first in range(0, size * parts, size)]
        return [Batch(self.original[r], self.target[r], self.palettes[r], self.observers[r]) for r in ranges]


class Examples:
    """Pairs of an image and its recolouring for one observer, each image with several observers.

    Args:
        dataset: where they are.
        samples: which of the dataset's samples to take.
        reporter: hears of the loading.
    """

    def __init__(self, dataset: PairedDataset, samples: Iterable[int], reporter: Reporter | None = None) -> None:
        reporter = reporter or Reporter()
        chosen = list(samples)
        self._images: list[NDArray[np.uint8]] = []
        self._palettes: list[Tensor] = []
        self._pairs: list[tuple[int, Observer, NDArray[np.uint8]]] = []
        for done, index in enumerate(chosen):
            sample = dataset.sample(index)
            for observer, target in zip(sample.observers, sample.targets, strict=True):
                self._pairs.append((len(self._images), Observer(*observer), target))
            self._images.append(sample.input)
            self._palettes.append(palette([sample.input]))
            reporter.progress("load", (done + 1) / len(chosen), f"{done + 1} of {len(chosen)} images")
        changes = np.array([_change(self._images[image], target) for image, _, target in self._pairs])
        self._hardness = (
            np.cumsum(changes) / changes.sum() if changes.sum() else np.linspace(0, 1, len(changes) + 1)[1:]
        )

    def __len__(self) -> int:
        return len(self._pairs)

    def draw(self, generator: np.random.Generator, count: int, size: int, hard_share: float) -> Batch:
        """Random crops of `size` pixels, turned and mirrored at random.

        Args:
            hard_share: probability that a pair is drawn in proportion to how much the teacher changes it.
        """
        hard = generator.random(count) < hard_share
        even = generator.integers(0, len(self), count)
        by_change = np.searchsorted(self._hardness, generator.random(count), side="right")
        pairs = np.where(hard, np.minimum(by_change, len(self) - 1), even)
        crops = []
        for pair in pairs:
            height, width = self._pairs[pair][2].shape[:2]
            top, left = generator.integers(0, height - size + 1), generator.integers(0, width - size + 1)
            turns, mirrored = int(generator.integers(4)), bool(generator.integers(2))
            crops.append((pair, slice(top, top + size), slice(left, left + size), turns, mirrored))
        return self._batch(crops)

    def whole(self, pairs: Iterable[int], stride: int = 32) -> Batch:
        """The whole images of some pairs, cut to sides that are multiples of `stride`; all have to be of one size."""
        crops = []
        for pair in pairs:
            height, width = (side - side % stride for side in self._pairs[pair][2].shape[:2])
            crops.append((pair, slice(0, height), slice(0, width), 0, False))
        return self._batch(crops)

    def _batch(self, crops: list[tuple[int, slice, slice, int, bool]]) -> Batch:
        originals: list[NDArray[np.uint8]] = []
        targets: list[NDArray[np.uint8]] = []
        for pair, rows, columns, turns, mirrored in crops:
            image, _, target = self._pairs[pair]
            for source, into in ((self._images[image], originals), (target, targets)):
                cut = np.rot90(source[rows, columns], turns)
                into.append(cut[:, ::-1] if mirrored else cut)
        return Batch(
            _to_tensor(originals),
            _to_tensor(targets),
            torch.stack([self._palettes[self._pairs[crop[0]][0]] for crop in crops]),
            [self._pairs[crop[0]][1] for crop in crops],
        )


def _to_tensor(images: list[NDArray[np.uint8]]) -> Tensor:
    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float() / 255.0


def _change(image: NDArray[np.uint8], target: NDArray[np.uint8]) -> float:
    """Mean absolute difference, from every fourth pixel along each side."""
    return float(np.abs(image[::4, ::4].astype(np.int16) - target[::4, ::4]).mean())


class ObserverBatch:
    """One observer for each image of a batch, simulated together.

    Args:
        observers: as many as the batch has images.
        device: where the images are.
    """

    def __init__(self, observers: Sequence[Observer], device: torch.device | str = "cpu") -> None:
        models = [linear_simulation(o.cvd, float(o.severity), o.simulation) for o in observers]
        self._above = _stack([m.matrix for m in models], device)
        self._below = _stack([m.matrix if m.matrix_below is None else m.matrix_below for m in models], device)
        self._separator = _stack([_separator(m) for m in models], device)
        self._piecewise = any(m.matrix_below is not None for m in models)
        self.features = torch.stack([observer_features(o) for o in observers]).to(device)
        self.severities = torch.tensor([float(o.severity) for o in observers], device=device)

    def simulate_linear(self, linear: Tensor) -> Tensor:
        """S between linear images: (B, 3, H, W) linear sRGB to the same, clipped to [0, 1]."""
        pixels = linear.flatten(2)
        result = self._above @ pixels
        if self._piecewise:
            result = torch.where(self._separator[:, None] @ pixels >= 0.0, result, self._below @ pixels)
        return result.clamp(0.0, 1.0).view_as(linear)

    def simulate(self, images: Tensor) -> Tensor:
        """S of (B, 3, H, W) display-referred sRGB, as `core.color.simulation.simulate` of each image."""
        return linear_to_srgb(self.simulate_linear(srgb_to_linear(images)))


def _stack(arrays: Sequence[NDArray[np.float64]], device: torch.device | str) -> Tensor:
    return torch.as_tensor(np.stack(arrays), dtype=torch.float32, device=device)


def _separator(model: LinearSimulation) -> NDArray[np.float64]:
    return np.zeros(3) if model.separator is None else model.separator
