"""Pairs of colours drawn from a scene's views: what the teacher compares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError


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


def sample_pairs(
    images: Sequence[NDArray[np.uint8]],
    count: int,
    generator: np.random.Generator,
    sampling: PairSampling = PairSampling(),
    alphas: Sequence[NDArray[np.uint8] | None] | None = None,
) -> NDArray[np.uint8]:
    """Draw `count` pairs of pixel colours, each first pixel with equal probability over all views.

    Args:
        images: (H, W, 3) uint8 views, of any sizes.
        count: number of pairs.
        generator: source of randomness.
        sampling: how the second pixel is chosen.
        alphas: (H, W) coverage per view or None; pixels with alpha 0 are never drawn.

    Returns:
        (count, 2, 3) uint8 colours, in random order.

    Raises:
        InputError: no view has a covered pixel.
    """
    views = _Views(images, alphas)
    first_view = views.draw_views(count, generator)
    second_view = first_view.copy()
    across = slice(count - count // 4, count)
    second_view[across] = views.draw_views(count // 4, generator)
    first, second = views.draw_pixels(first_view, generator), views.draw_pixels(second_view, generator)
    local = slice(0, count // 2)
    radii = sampling.local_radius * views.shorter_sides(first_view[local]) / sampling.reference_size
    second[local] = views.draw_near(first_view[local], first[local], radii, generator)
    colors = np.stack([_gather(images, first_view, first), _gather(images, second_view, second)], 1)
    return colors[generator.permutation(count)]


def sample_neighbours(
    images: Sequence[NDArray[np.uint8]],
    count: int,
    generator: np.random.Generator,
    alphas: Sequence[NDArray[np.uint8] | None] | None = None,
) -> NDArray[np.uint8]:
    """Draw `count` pairs of adjacent pixels (8-neighbours, or a pixel and itself); otherwise as `sample_pairs`."""
    views = _Views(images, alphas)
    view = views.draw_views(count, generator)
    first = views.draw_pixels(view, generator)
    second = views.draw_near(view, first, np.ones(count), generator)
    return np.stack([_gather(images, view, first), _gather(images, view, second)], 1)


class _Views:
    """Pixels of several images, by the number of the view and the flat index in it."""

    def __init__(self, images: Sequence[NDArray[np.uint8]], alphas: Sequence[NDArray[np.uint8] | None] | None) -> None:
        self._shapes = np.array([image.shape[:2] for image in images])
        alphas = [None] * len(images) if alphas is None else alphas
        self._coverage = {view: alpha > 0 for view, alpha in enumerate(alphas) if alpha is not None}
        self._covered = {view: np.flatnonzero(mask) for view, mask in self._coverage.items()}
        self._sizes = self._shapes.prod(1)
        for view, covered in self._covered.items():
            self._sizes[view] = len(covered)
        if not self._sizes.any():
            raise InputError("no view has a visible pixel", remedy="check the alpha channels of the photographs")

    def draw_views(self, count: int, generator: np.random.Generator) -> NDArray[np.int64]:
        """(count,) view numbers, each with the probability of its share of the covered pixels."""
        return generator.choice(len(self._sizes), count, p=self._sizes / self._sizes.sum())

    def draw_pixels(self, views: NDArray[np.int64], generator: np.random.Generator) -> NDArray[np.int64]:
        """A covered pixel of each view."""
        pixels = (generator.random(len(views)) * self._sizes[views]).astype(np.int64)
        for view, covered in self._covered.items():
            here = views == view
            pixels[here] = covered[pixels[here]]
        return pixels

    def shorter_sides(self, views: NDArray[np.int64]) -> NDArray[np.int64]:
        """Shorter side of each view, in pixels."""
        return self._shapes[views].min(1)

    def draw_near(
        self,
        views: NDArray[np.int64],
        pixels: NDArray[np.int64],
        radii: NDArray[np.float64],
        generator: np.random.Generator,
    ) -> NDArray[np.int64]:
        """A pixel within the radius (1 at least) of each of `pixels`, in a square; itself where that is not covered."""
        height, width = self._shapes[views].T
        radius = np.maximum(np.round(radii), 1.0)
        offset = np.floor(generator.random((2, len(pixels))) * (2.0 * radius + 1.0)) - radius
        row = np.clip(pixels // width + offset[0].astype(np.int64), 0, height - 1)
        column = np.clip(pixels % width + offset[1].astype(np.int64), 0, width - 1)
        near = row * width + column
        for view, mask in self._coverage.items():
            here = np.flatnonzero(views == view)
            hidden = here[~mask.reshape(-1)[near[here]]]
            near[hidden] = pixels[hidden]
        return near


def _gather(
    images: Sequence[NDArray[np.uint8]], views: NDArray[np.int64], pixels: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """(P, 3) colours of the pixels."""
    colors = np.empty((len(views), 3), np.uint8)
    for view, image in enumerate(images):
        here = views == view
        colors[here] = image.reshape(-1, 3)[pixels[here]]
    return colors
