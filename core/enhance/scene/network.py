"""The network: what it computes for a pixel, from its colour and from how that differs from its surroundings.

    f(x) = clip(x + gate(x) (table(x) + 0.2 perceptron(x, S(x) - x, skin likeness, differences from the surroundings)))

The table alone is a mapping of colours. The perceptron may treat places of one colour differently, but sees only what
surrounds them, not where they lie: views of one place agree as far as its surroundings do.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from ...color.protected_colors import skin_likeness
from ...color.simulation import Observer
from ..lut import CUBE_SIZE, ColorLut, interpolate

NODES = 9
"""Of the table, along an edge."""

HIDDEN = 32
"""Width of the perceptron's two hidden layers."""

SURROUNDINGS = (1 / 64, 1 / 20, 1 / 8)
"""Sizes of the surroundings, as parts of the shorter side: a detail, an object's part, an object."""

REFERENCE_SIDE = 256
"""Pixels; surroundings are averages over a copy whose shorter side is no longer than that."""

TABLE = "table"
"""Name of the table among the parameters."""

PROPORTIONAL = (TABLE, "last.weight", "last.bias")
"""Names of the parameters that every colour's change is proportional to."""

_LEAST_CELL = 2.0  # pixels; averages over single pixels are no surroundings
_OWN = 7  # features of the colour itself: x, S(x) - x, skin likeness
_SEEN = 6  # of them, those that are compared with their surroundings: x and S(x) - x
_SEEN_SCALE, _DIFFERENCE_SCALE, _OUTPUT_SCALE = 2.0, 4.0, 0.2  # bring features and first steps to a similar size
_GREY = 0.03  # max - min of a colour's channels at which half of the change remains; 8 levels of 255

Surroundings = Sequence[Tensor]
"""For each of `SURROUNDINGS` (6, rows, columns) averages of `seen_features` over the cells of a grid."""


class SceneNetwork(nn.Module):
    """A recolouring for one observer; see the module.

    Args:
        observer: for whom.
        hidden: width of the perceptron's hidden layers.

    Attributes:
        table: (N, N, N, 3), as `ColorLut.residual`; zero at first, as is the perceptron's output.
    """

    def __init__(self, observer: Observer, hidden: int = HIDDEN) -> None:
        super().__init__()
        self.observer = observer
        self.table = nn.Parameter(torch.zeros(NODES, NODES, NODES, 3))
        self.first = nn.Linear(_OWN + _SEEN * len(SURROUNDINGS), hidden)
        self.second = nn.Linear(hidden, hidden)
        self.last = nn.Linear(hidden, 3)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, colors: Tensor, features: Tensor | None = None) -> Tensor:
        """(P, 3) sRGB and the (P, 25) `features` of the pixels to (P, 3), not clipped; None leaves the table alone."""
        return self.changed(colors, None if features is None else self.first(features))

    def changed(self, colors: Tensor, hidden: Tensor | None) -> Tensor:
        """As the call, from the (P, hidden) sums of the first layer."""
        change = interpolate(self.table, colors[None])[0]
        if hidden is not None:
            hidden = functional.hardswish(self.second(functional.hardswish(hidden)))
            change = torch.add(change, self.last(hidden), alpha=_OUTPUT_SCALE)
        return torch.addcmul(colors, gate(colors), change)

    def first_of_colors(self) -> tuple[Tensor, list[Tensor]]:
        """The first layer, sorted by what does and what does not change from pixel to pixel.

        Returns:
            (hidden, 7) weights of a pixel's `own_features`, and for each of `SURROUNDINGS` (hidden, 6) weights of its
            averages: together with the bias they give the layer's sums.
        """
        weights = self.first.weight.detach()
        own = weights[:, :_OWN].clone()
        around = [_DIFFERENCE_SCALE * part for part in weights[:, _OWN:].split(_SEEN, 1)]
        own[:, :_SEEN] += torch.stack(around).sum(0)
        return own, [-part for part in around]

    def scale(self, factor: float) -> None:
        """Multiply the change of every colour by `factor`."""
        with torch.no_grad():
            for name in PROPORTIONAL:
                self.get_parameter(name).mul_(factor)


def table_roughness(table: Tensor) -> Tensor:
    """Sum over the three axes of a table's mean squared second difference."""
    return torch.stack([torch.diff(table, n=2, dim=axis).pow(2).mean() for axis in range(3)]).sum()


def table_lut(table: Tensor) -> ColorLut:
    """The LUT of a network that has a (N, N, N, 3) table and no perceptron."""
    axis = torch.linspace(0.0, 1.0, CUBE_SIZE)
    colors = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    change = gate(colors) * interpolate(table.detach(), colors[None])[0]
    return ColorLut(change.reshape(*(CUBE_SIZE,) * 3, 3))


def gate(colors: Tensor) -> Tensor:
    """(P, 1) in [0, 1] for (P, 3) colours: 0 for greys, which look alike to everyone and stay; nearly 1 for colours."""
    chroma = (colors.amax(1, keepdim=True) - colors.amin(1, keepdim=True)) ** 2
    return chroma / (chroma + _GREY**2)


def seen_features(image: Tensor, observer: Observer) -> Tensor:
    """(6, H, W): the colours of a (3, H, W) image about mid-grey, and what the observer sees differently."""
    return torch.cat([image - 0.5, _SEEN_SCALE * (observer.simulate(image) - image)])


def own_features(image: Tensor, seen: Tensor) -> Tensor:
    """(7, H, W): the `seen_features` and the skin likeness of a (3, H, W) image."""
    return torch.cat([seen, skin_likeness(image)[None] - 0.5])


def features(image: Tensor, observer: Observer, coverage: Tensor | None = None) -> Tensor:
    """(P, 25) what the perceptron sees of the pixels of a (3, H, W) image, no larger than `REFERENCE_SIDE`.

    Args:
        coverage: (H, W) in [0, 1]; what is not covered surrounds nothing.
    """
    seen = seen_features(image, observer)
    size = image.shape[-2:]
    differences = []
    for grid in surroundings(image, observer, coverage):
        down, across = (interpolation(0, side, side, cells) for side, cells in zip(size, grid.shape[1:], strict=True))
        differences.append(_DIFFERENCE_SCALE * (seen - down @ grid @ across.T))
    return torch.cat([own_features(image, seen), *differences]).flatten(1).T.contiguous()


def interpolation(first: int, last: int, side: int, cells: int) -> Tensor:
    """(last - first, cells) weights of the cells along a side of an image for its pixels from `first` to `last`.

    The values of the cells are interpolated linearly between their middles. A pixel's weights depend on its place
    alone, so that pieces of an image fit together.
    """
    position = ((torch.arange(first, last, dtype=torch.float64) + 0.5) * (cells / side) - 0.5).clamp(0.0, cells - 1.0)
    distance = (position[:, None] - torch.arange(cells, dtype=torch.float64)).abs()
    return (1.0 - distance).clamp(min=0.0).float()


def surroundings(image: Tensor, observer: Observer, coverage: Tensor | None = None) -> Surroundings:
    """The surroundings in a (3, H, W) image; `coverage`: see `features`."""
    size = image.shape[-2:]
    weight = torch.ones(1, *size) if coverage is None else coverage[None]
    seen = seen_features(image, observer) * weight
    everywhere = seen.mean((1, 2)) / weight.mean().clamp(min=torch.finfo(weight.dtype).tiny)
    grids = []
    for part in SURROUNDINGS:
        cell = max(_LEAST_CELL, part * min(size))
        rows, columns = (max(round(side / cell), 1) for side in size)
        summed = functional.adaptive_avg_pool2d(torch.cat([seen, weight])[None], (rows, columns))[0]
        covered = summed[_SEEN:]
        average = summed[:_SEEN] / covered.clamp(min=torch.finfo(weight.dtype).tiny)
        grids.append(torch.where(covered > 0.0, average, everywhere[:, None, None]))
    return grids
