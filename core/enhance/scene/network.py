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
from ..lut import ColorLut, interpolate

NODES = 9
"""Of the table, along an edge."""

HIDDEN = 32
"""Width of the perceptron's two hidden layers."""

SURROUNDINGS = (1 / 64, 1 / 20, 1 / 8)
"""Sizes of the surroundings, as parts of the shorter side: a detail, an object's part, an object."""

REFERENCE_SIDE = 256
"""Pixels; surroundings are averages over a copy whose shorter side is no longer than that."""

_LEAST_CELL = 2.0  # pixels; averages over single pixels are no surroundings
_OWN = 7  # features of the colour itself: x, S(x) - x, skin likeness
_SEEN = 6  # of them, those that are compared with their surroundings: x and S(x) - x
_SEEN_SCALE, _DIFFERENCE_SCALE, _OUTPUT_SCALE = 2.0, 4.0, 0.2  # bring features and first steps to a similar size
_GREY = 0.03  # max - min of a colour's channels at which half of the change remains; 8 levels of 255
_CUBE_NODES = 33  # of the table with its gate; as many as an exported file has

Surroundings = Sequence[Tensor]
"""For each of `SURROUNDINGS` (6, rows, columns) averages of `seen_features` over the cells of a grid."""


class SceneNetwork(nn.Module):
    """A recolouring for one observer; see the module.

    Args:
        observer: for whom.
        hidden: width of the perceptron's hidden layers.
        nodes: of the table, along an edge.

    Attributes:
        table: (N, N, N, 3), as `ColorLut.residual`; zero at first, as is the perceptron's output.
    """

    def __init__(self, observer: Observer, hidden: int = HIDDEN, nodes: int = NODES) -> None:
        super().__init__()
        self.observer = observer
        self.table = nn.Parameter(torch.zeros(nodes, nodes, nodes, 3))
        self.first = nn.Linear(_OWN + _SEEN * len(SURROUNDINGS), hidden)
        self.second = nn.Linear(hidden, hidden)
        self.last = nn.Linear(hidden, 3)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, colors: Tensor, features: Tensor | None = None) -> Tensor:
        """(3, P) sRGB and the (25, P) `features` of the pixels to (3, P), not clipped; None leaves the table alone."""
        change = interpolate(self.table, colors.T[None])[0].T
        if features is not None:
            change = change + _OUTPUT_SCALE * self.perceptron(features)
        return colors + gate(colors) * change

    def perceptron(self, features: Tensor) -> Tensor:
        """(25, P) features to (3, P)."""
        hidden = functional.silu(torch.addmm(self.first.bias[:, None], self.first.weight, features))
        hidden = functional.silu(torch.addmm(self.second.bias[:, None], self.second.weight, hidden))
        return torch.addmm(self.last.bias[:, None], self.last.weight, hidden)

    def table_roughness(self) -> Tensor:
        """Sum over the three axes of the table's mean squared second difference."""
        return torch.stack([torch.diff(self.table, n=2, dim=axis).pow(2).mean() for axis in range(3)]).sum()

    def scale(self, factor: float) -> None:
        """Multiply the change of every colour by `factor`."""
        with torch.no_grad():
            for part in (self.table, self.last.weight, self.last.bias):
                part.mul_(factor)

    def lut(self) -> ColorLut:
        """The part that is a table, with its gate."""
        axis = torch.linspace(0.0, 1.0, _CUBE_NODES)
        colors = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).flatten(1)
        with torch.no_grad():
            change = self(colors) - colors
        return ColorLut(change.T.reshape(*(_CUBE_NODES,) * 3, 3).contiguous())


def gate(colors: Tensor) -> Tensor:
    """(1, P) in [0, 1]: 0 for greys, which look alike to every observer and stay; nearly 1 for colours."""
    chroma = (colors.amax(0, keepdim=True) - colors.amin(0, keepdim=True)) ** 2
    return chroma / (chroma + _GREY**2)


def seen_features(image: Tensor, observer: Observer) -> Tensor:
    """(6, H, W): the colours of a (3, H, W) image about mid-grey, and what the observer sees differently."""
    return torch.cat([image - 0.5, _SEEN_SCALE * (observer.simulate(image) - image)])


def own_features(image: Tensor, seen: Tensor) -> Tensor:
    """(7, H, W): the `seen_features` and the skin likeness of a (3, H, W) image."""
    return torch.cat([seen, skin_likeness(image)[None] - 0.5])


def features(image: Tensor, observer: Observer, coverage: Tensor | None = None) -> Tensor:
    """(25, P) what the perceptron sees of the pixels of a (3, H, W) image, no larger than `REFERENCE_SIDE`.

    Args:
        coverage: (H, W) in [0, 1]; what is not covered surrounds nothing.
    """
    seen = seen_features(image, observer)
    own = own_features(image, seen)
    averages = surroundings(image, observer, coverage)
    rows, columns = (torch.arange(side) for side in image.shape[-2:])
    return torch.cat([own.flatten(1), around(own, averages, rows, columns, image.shape[-2:]).flatten(1)])


def around(own: Tensor, averages: Surroundings, rows: Tensor, columns: Tensor, size: tuple[int, ...]) -> Tensor:
    """(18, h, w) how the pixels in `rows` and `columns` of an image of `size` differ from their surroundings.

    Args:
        own: (7, h, w) their `own_features`.
    """
    seen = own[:_SEEN]
    return torch.cat([_DIFFERENCE_SCALE * (seen - _enlarge(grid, rows, columns, size)) for grid in averages])


def surroundings(image: Tensor, observer: Observer, coverage: Tensor | None = None) -> Surroundings:
    """The surroundings in a (3, H, W) image; `coverage`: see `features`."""
    size = image.shape[-2:]
    weight = torch.ones(1, *size) if coverage is None else coverage[None]
    seen = seen_features(image, observer) * weight
    everywhere = seen.mean((1, 2)) / weight.mean().clamp(min=torch.finfo(weight.dtype).tiny)
    grids = []
    for part in SURROUNDINGS:
        cell = max(_LEAST_CELL, part * min(size))
        cells = [max(round(side / cell), 1) for side in size]
        summed = functional.adaptive_avg_pool2d(torch.cat([seen, weight])[None], cells)[0]
        covered = summed[_SEEN:]
        average = summed[:_SEEN] / covered.clamp(min=torch.finfo(weight.dtype).tiny)
        grids.append(torch.where(covered > 0.0, average, everywhere[:, None, None]))
    return grids


def _enlarge(grid: Tensor, rows: Tensor, columns: Tensor, size: tuple[int, ...]) -> Tensor:
    """The bilinear interpolation of a (C, rows, columns) grid over an image of `size` at some rows and columns.

    A pixel's value depends on nothing but its place, so that pieces of an image fit together.
    """
    for axis, (places, side) in enumerate(((rows, size[0]), (columns, size[1])), start=1):
        cells = grid.shape[axis]
        position = ((places + 0.5) * (cells / side) - 0.5).clamp(0.0, cells - 1.0)
        lower = position.long().clamp(max=max(cells - 2, 0))
        upper = (lower + 1).clamp(max=cells - 1)
        share = (position - lower).to(grid.dtype)
        share = share[:, None] if axis == 1 else share
        grid = torch.lerp(grid.index_select(axis, lower), grid.index_select(axis, upper), share)
    return grid
