"""Applies a scene network to an image of any size, tile by tile: memory grows with the tile, not with the area."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ...files.images import to_bytes
from ...runtime.threads import one_thread
from .network import (
    REFERENCE_SIDE,
    SceneNetwork,
    Surroundings,
    interpolation,
    own_features,
    seen_features,
    surroundings,
)

TILE_SIDE = 256
"""Pixels; 30 MB of intermediate results, of which each fits into a processor's cache."""

_MOST_THREADS = 4  # each with a tile's intermediate results
_FEWEST_TILES, _LEAST_ROWS = 2, 32  # so that two threads have work; but no tile is cut smaller for that
_BAND = 1 << 20  # pixels of an image that are in memory as floating point at a time


def recolour(
    network: SceneNetwork,
    image: NDArray,
    result: NDArray,
    alpha: NDArray[np.uint8] | None = None,
    strength: float = 1.0,
    tile_side: int = TILE_SIDE,
) -> None:
    """Write image + strength (f(image) - image) into `result`.

    Args:
        image: (H, W, 3) uint8, or floating point in [0, 1].
        result: (H, W, 3) uint8 or float32; it may be `image` itself.
        alpha: (H, W) coverage; what is not covered surrounds nothing.
        tile_side: no pixel's result depends on it.
    """
    with torch.inference_mode():
        tiles = _Tiles(network, image_surroundings(network, image, alpha), image.shape[:2])
    # A tile a thread instead of all threads on each tile, which would wait for each other after every operation.
    threads = min(torch.get_num_threads(), _MOST_THREADS)
    height, width = _tile_size(image.shape[:2], tile_side)
    corners = [(top, left) for top in range(0, image.shape[0], height) for left in range(0, image.shape[1], width)]

    def recolour_tile(corner: tuple[int, int]) -> None:
        place = tuple(slice(first, first + side) for first, side in zip(corner, (height, width), strict=True))
        with torch.inference_mode():  # which is a thread's own
            colors = _as_tensor(image[place])
            shown = tiles.shown(colors, *corner).clamp_(0.0, 1.0)
            tile = torch.lerp(colors, shown, strength).permute(1, 2, 0).numpy()
        result[place] = to_bytes(tile) if result.dtype == np.uint8 else tile

    with one_thread(), ThreadPoolExecutor(max(min(threads, len(corners)), 1), "recolour") as pool:
        list(pool.map(recolour_tile, corners))


def _tile_size(size: tuple[int, ...], most: int) -> tuple[int, int]:
    """(height, width) of tiles that divide an image of `size` evenly, the same on any machine, so that the bits are."""
    columns = max(-(-size[1] // most), 1)
    rows = max(-(-size[0] // most), min(-(-_FEWEST_TILES // columns), size[0] // _LEAST_ROWS), 1)
    return max(-(-size[0] // rows), 1), max(-(-size[1] // columns), 1)


def image_surroundings(network: SceneNetwork, image: NDArray, alpha: NDArray[np.uint8] | None) -> Surroundings:
    """The surroundings in an (H, W, 3) image, from a copy whose shorter side is `REFERENCE_SIDE` pixels at most."""
    factor = min(REFERENCE_SIDE / min(image.shape[:2]), 1.0)
    height, width = (max(round(side * factor), 1) for side in image.shape[:2])
    narrow = []
    rows = max(_BAND // image.shape[1], 1)  # averaged along at a time, then all of them downwards
    for top in range(0, image.shape[0], rows):
        colors = _as_tensor(image[top : top + rows])
        covered = (
            torch.ones_like(colors[:1])
            if alpha is None
            else torch.from_numpy(alpha[top : top + rows]).float()[None] / 255.0
        )
        band = torch.cat([colors * covered, covered])
        narrow.append(functional.adaptive_avg_pool2d(band, (band.shape[1], width)))
    small = functional.adaptive_avg_pool2d(torch.cat(narrow, 1), (height, width))
    coverage = small[3]
    colors = (small[:3] / coverage.clamp(min=torch.finfo(small.dtype).tiny)).clamp_(0.0, 1.0)
    return surroundings(colors, network.observer, None if alpha is None else coverage)


class _Tiles:
    """What all tiles of an image need: the first layer's weights, and what the surroundings add to its sums."""

    def __init__(self, network: SceneNetwork, averages: Surroundings, size: tuple[int, ...]) -> None:
        self._network, self._size = network, size
        self._own, around = network.first_of_colors()
        # Multiplied before they are enlarged: there are few cells and many pixels.
        self._added = [
            torch.einsum("chw,oc->hwo", grid, weights) for grid, weights in zip(averages, around, strict=True)
        ]

    def shown(self, colors: Tensor, top: int, left: int) -> Tensor:
        """(3, h, w) result, not clipped, for a tile of the image whose upper left corner is at `top`, `left`."""
        height, width = colors.shape[1:]
        across, rows = [], []
        for grid in self._added:
            down = interpolation(top, top + height, self._size[0], grid.shape[0])
            along = interpolation(left, left + width, self._size[1], grid.shape[1])
            used = along.any(0)  # a tile lies in few of the cells
            across.append(along[:, used])
            rows.append(torch.tensordot(down, grid[:, used], 1))
        hidden = torch.matmul(torch.cat(across, 1), torch.cat(rows, 1)).flatten(0, 1)
        own = own_features(colors, seen_features(colors, self._network.observer)).flatten(1)
        hidden.addmm_(own.T, self._own.T).add_(self._network.first.bias)
        return self._network.changed(colors.flatten(1).T.contiguous(), hidden).T.reshape(colors.shape)


def _as_tensor(image: NDArray) -> Tensor:
    """(H, W, 3) uint8 or floating point to (3, H, W) float32 in [0, 1]."""
    pixels = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))
    return pixels.float() / 255.0 if pixels.dtype == torch.uint8 else pixels.float()
