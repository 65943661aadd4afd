"""Pairs of colours drawn from a scene's views: what the LUT's fit compares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

Images = Sequence[NDArray[np.uint8]]
"""(H, W, 3) views of a scene, of any sizes."""

Alphas = Sequence[NDArray[np.uint8] | None] | None
"""(H, W) coverage of each view, or None where it is opaque; None where all are."""


@dataclass(frozen=True)
class PairSampling:
    """How pairs are drawn. Half of them are local, a quarter lie anywhere in one view, a quarter in any two views.

    Attributes:
        local_radius: largest offset of a local pair along x and y, in pixels of an image of `reference_size`.
        reference_size: shorter side, in pixels, of the images for which `local_radius` holds. Larger images are sampled
            at proportionally larger offsets, not reduced: averaging would hide the colours of single yarns.
    """

    local_radius: float = 15.0
    reference_size: int = 256

    def radius(self, shape: tuple[int, ...]) -> int:
        """Largest offset of a local pair in an image of this height and width; 1 at least."""
        return max(round(self.local_radius * min(shape) / self.reference_size), 1)


def sample_pairs(
    images: Images,
    count: int,
    generator: np.random.Generator,
    sampling: PairSampling = PairSampling(),
    alphas: Alphas = None,
) -> NDArray[np.uint8]:
    """Draw `count` pairs of pixel colours, each pixel of all views with equal probability.

    Args:
        count: number of pairs.
        sampling: how the second pixel is chosen.
        alphas: pixels with alpha 0 are never drawn.

    Returns:
        (count, 2, 3) uint8 colours, in random order.

    Raises:
        InputError: no view has a covered pixel.
    """
    views = _views(images, alphas)

    def local(view: _View, number: int) -> NDArray[np.uint8]:
        return view.near(number, sampling.radius(view.shape), generator)

    def within(view: _View, number: int) -> NDArray[np.uint8]:
        return view.anywhere(number, 2, generator)

    def single(view: _View, number: int) -> NDArray[np.uint8]:
        return view.anywhere(number, 1, generator)

    quarter = count // 4
    across = [generator.permutation(_draw(views, quarter, generator, single)) for _ in range(2)]
    pairs = [
        _draw(views, count // 2, generator, local),
        _draw(views, count - count // 2 - quarter, generator, within),
        np.concatenate(across, axis=1),
    ]
    return generator.permutation(np.concatenate(pairs))


def sample_neighbours(
    images: Images, count: int, generator: np.random.Generator, alphas: Alphas = None
) -> NDArray[np.uint8]:
    """Draw `count` pairs of adjacent pixels (8-neighbours, or a pixel and itself); otherwise as `sample_pairs`."""
    return _draw(_views(images, alphas), count, generator, lambda view, number: view.near(number, 1, generator))


class _View:
    """The covered pixels of one image."""

    def __init__(self, image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None) -> None:
        self.shape = image.shape[:2]
        self._colors = image.reshape(-1, 3)
        self._covered = None if alpha is None else np.flatnonzero(alpha)
        self._visible = None if alpha is None else alpha.reshape(-1) > 0

    def __len__(self) -> int:
        return len(self._colors if self._covered is None else self._covered)

    def anywhere(self, count: int, group: int, generator: np.random.Generator) -> NDArray[np.uint8]:
        """(count, group, 3) colours of independent pixels."""
        return self._colors[self._pixels(count * group, generator)].reshape(count, group, 3)

    def near(self, count: int, radius: int, generator: np.random.Generator) -> NDArray[np.uint8]:
        """(count, 2, 3) colours of pixels and of others at most `radius` pixels away along x and y.

        A pixel stands in for its partner where that one is not covered.
        """
        height, width = self.shape
        first = self._pixels(count, generator)
        row, column = np.divmod(first, width)
        offset = generator.integers(-radius, radius + 1, (2, count))
        second = np.clip(row + offset[0], 0, height - 1) * width + np.clip(column + offset[1], 0, width - 1)
        if self._visible is not None:
            second = np.where(self._visible[second], second, first)
        return self._colors[np.stack([first, second], 1)]

    def _pixels(self, count: int, generator: np.random.Generator) -> NDArray[np.int64]:
        """(count,) flat indices of covered pixels."""
        drawn = generator.integers(0, len(self), count)
        return drawn if self._covered is None else self._covered[drawn]


def _views(images: Images, alphas: Alphas) -> list[_View]:
    """The views that have a covered pixel."""
    alphas = [None] * len(images) if alphas is None else alphas
    views = [_View(image, alpha) for image, alpha in zip(images, alphas, strict=True)]
    views = [view for view in views if len(view)]
    if not views:
        raise InputError("no view has a visible pixel", remedy="check the alpha channels of the photographs")
    return views


def _draw(
    views: Sequence[_View], count: int, generator: np.random.Generator, draw: Callable[[_View, int], NDArray[np.uint8]]
) -> NDArray[np.uint8]:
    """What `draw` gives for each view, `count` in all, shared out by the views' numbers of pixels."""
    sizes = np.array([len(view) for view in views])
    numbers = generator.multinomial(count, sizes / sizes.sum())
    return np.concatenate([draw(view, int(number)) for view, number in zip(views, numbers, strict=True)])
