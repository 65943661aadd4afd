"""How a video's picture moves: points that are followed from frame to frame, and what two frames see of each other.

Lucas and Kanade's method on a pyramid (Bouguet 2001, "Pyramidal implementation of the Lucas Kanade feature tracker"),
with new points wherever a part of the picture has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

WIDTH = 320
"""Pixels of the longer side of the pictures in which points are followed."""

_LEVELS = 4
_RADIUS = 5  # of a patch
_ITERATIONS = 5  # on each level
_CELL = 20  # pixels; each cell of the picture has a point where there is something to follow
_LEAST_CORNER = 2e-4  # smaller eigenvalue of a patch's mean gradient products; grey values are 0 to 1
_MOST_RESIDUAL = 0.06  # mean difference of grey values between a patch and where it was found
_MOST_RETURN = 0.7  # pixels between a point and where it comes back to
_FEW_POINTS = 24
_LEAST_POINTS = 8  # that a turn of the camera is fitted to
_FOCAL_LENGTHS = (0.65, 0.85, 1.15)  # of lenses that telephones have, in longer sides of the picture


@dataclass(frozen=True)
class Followed:
    """The points of one frame.

    Attributes:
        numbers: (N,) ascending; a point keeps its number from frame to frame.
        places: (N, 2) float32, x and y in pixels.
        size: (width, height) of the picture.
    """

    numbers: NDArray[np.int64]
    places: NDArray[np.float32]
    size: tuple[int, int]


@dataclass(frozen=True)
class Motion:
    """What happened between two frames, in longer sides of the picture.

    Attributes:
        shift: median way of the points that both see.
        parallax: what of it no turn of the camera explains (median). Without it nothing new is learned of depths.
        lost: share of the first frame's points that the second does not see; 0 where it has too few to say.
    """

    shift: float
    parallax: float
    lost: float


class Follower:
    """Follows points through the pictures it is given."""

    def __init__(self) -> None:
        self._pyramid: list[Tensor] = []
        self._numbers = torch.zeros(0, dtype=torch.int64)
        self._places = torch.zeros(0, 2)
        self._next = 0

    def advance(self, grey: NDArray[np.uint8]) -> Followed:
        """The points of the next frame, an (H, W) picture with the longer side `WIDTH`."""
        pyramid = _pyramid(torch.from_numpy(grey.astype(np.float32) / 255.0))
        if self._pyramid and self._pyramid[0].shape == pyramid[0].shape and len(self._numbers):
            found, good = _follow(self._pyramid, pyramid, self._places)
            back, returned = _follow(pyramid, self._pyramid, found)
            good &= returned & ((back - self._places).norm(dim=1) < _MOST_RETURN)
            self._numbers, self._places = self._numbers[good], found[good]
        else:
            self._numbers, self._places = self._numbers[:0], self._places[:0]
        self._pyramid = pyramid
        self._add_points(pyramid[0])
        height, width = grey.shape
        return Followed(self._numbers.numpy().copy(), self._places.numpy().copy(), (width, height))

    def _add_points(self, picture: Tensor) -> None:
        """A new point, the best corner, in each cell that has none."""
        height, width = picture.shape
        rows, columns = height // _CELL, width // _CELL
        if not rows or not columns:
            return
        strength = _corner_strength(picture)
        edge = _RADIUS + 1
        strength[:edge], strength[-edge:], strength[:, :edge], strength[:, -edge:] = 0.0, 0.0, 0.0, 0.0
        cells = strength[: rows * _CELL, : columns * _CELL].reshape(rows, _CELL, columns, _CELL).transpose(1, 2)
        best, where = cells.reshape(rows * columns, -1).max(1)
        free = best > _LEAST_CORNER
        taken = (self._places / _CELL).long()
        inside = (taken[:, 0] < columns) & (taken[:, 1] < rows)
        free[(taken[:, 1] * columns + taken[:, 0])[inside]] = False
        cell = torch.nonzero(free)[:, 0]
        x = cell % columns * _CELL + where[cell] % _CELL
        y = cell // columns * _CELL + where[cell] // _CELL
        added = torch.stack([x, y], 1).float()
        self._places = torch.cat([self._places, added])
        self._numbers = torch.cat([self._numbers, torch.arange(self._next, self._next + len(added))])
        self._next += len(added)


def motion_between(first: Followed, second: Followed) -> Motion | None:
    """What happened from `first` to `second`, by the points that both have; None where these are too few to say.

    That is so of a bare wall, and of frames that are so blurred that there is nothing to follow.
    """
    _, here, there = np.intersect1d(first.numbers, second.numbers, assume_unique=True, return_indices=True)
    lost = 1.0 - len(here) / max(len(first.numbers), 1)
    if len(here) < _LEAST_POINTS:
        return Motion(0.0, 0.0, lost) if len(first.numbers) >= _FEW_POINTS else None
    if len(first.numbers) < _FEW_POINTS:  # of so few, noise makes and unmakes a good part
        lost = 0.0
    a, b = first.places[here].astype(np.float64), second.places[there].astype(np.float64)
    longer = max(first.size)
    shift = float(np.median(np.linalg.norm(b - a, axis=1))) / longer
    center = np.array(first.size) / 2.0
    left = min(_unexplained(a - center, b - center, focal * longer) for focal in _FOCAL_LENGTHS)
    return Motion(shift, left / longer, lost)


def _unexplained(a: NDArray[np.float64], b: NDArray[np.float64], focal: float) -> float:
    """Median distance in pixels between `b` and where the best turn of a camera takes `a`, both (N, 2) from the centre.

    The turn is Kabsch's, made again from the points that fit it well.
    """
    rays = [np.column_stack([points / focal, np.ones(len(points))]) for points in (a, b)]
    unit = [ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays]
    used = np.ones(len(a), bool)
    distance = np.zeros(len(a))
    for _ in range(3):
        left, _, right = np.linalg.svd(unit[0][used].T @ unit[1][used])
        turn = right.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(right.T @ left.T))]) @ left.T
        turned = rays[0] @ turn.T
        distance = np.linalg.norm(turned[:, :2] / np.maximum(turned[:, 2:], 0.1) * focal - b, axis=1)
        used = distance <= max(2.0 * float(np.median(distance)), 1e-6)
    return float(np.median(distance))


def _pyramid(picture: Tensor) -> list[Tensor]:
    levels = [picture]
    while len(levels) < _LEVELS and min(levels[-1].shape) >= 4 * (2 * _RADIUS + 1):
        levels.append(F.avg_pool2d(levels[-1][None, None], 2)[0, 0])
    return levels


def _corner_strength(picture: Tensor) -> Tensor:
    """(H, W) smaller eigenvalue of the mean products of gradients around each pixel (Shi and Tomasi 1994)."""
    x, y = _gradients(picture)
    means = F.avg_pool2d(torch.stack([x * x, x * y, y * y])[None], 2 * _RADIUS + 1, 1, _RADIUS)[0]
    half = (means[0] + means[2]) / 2.0
    return half - ((means[0] - means[2]).square() / 4.0 + means[1].square()).sqrt()


def _gradients(picture: Tensor) -> tuple[Tensor, Tensor]:
    padded = F.pad(picture[None, None], (1, 1, 1, 1), mode="replicate")[0, 0]
    return (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2.0, (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2.0


def _follow(first: list[Tensor], second: list[Tensor], places: Tensor) -> tuple[Tensor, Tensor]:
    """Where the (N, 2) points of the first picture are in the second, and whether they were found."""
    steps = torch.arange(-_RADIUS, _RADIUS + 1, dtype=torch.float32)
    patch = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1).reshape(1, -1, 2)
    shift = torch.zeros_like(places)
    residual = torch.zeros(len(places))
    for level in reversed(range(len(first))):
        scale = 2.0**level
        at = places / scale + (0.5 / scale - 0.5)  # pixel centres of a coarser level lie between those of a finer one
        grids = at[:, None] + patch
        x, y = _gradients(first[level])
        template, x, y = _sample(torch.stack([first[level], x, y]), grids)
        xx, xy, yy = (x * x).sum(1), (x * y).sum(1), (y * y).sum(1)
        determinant = (xx * yy - xy * xy).clamp(min=1e-9)
        for _ in range(_ITERATIONS):
            error = _sample(second[level][None], grids + shift[:, None] / scale)[0] - template
            error = error - error.mean(1, keepdim=True)  # the exposure may have changed
            to_x, to_y = (x * error).sum(1), (y * error).sum(1)
            step = torch.stack([yy * to_x - xy * to_y, xx * to_y - xy * to_x], 1) / determinant[:, None]
            shift = shift - step.clamp(-_RADIUS, _RADIUS) * scale
        residual = error.abs().mean(1)
    found = places + shift
    height, width = second[0].shape
    inside = (found > _RADIUS).all(1) & (found[:, 0] < width - 1 - _RADIUS) & (found[:, 1] < height - 1 - _RADIUS)
    return found, inside & (residual < _MOST_RESIDUAL)


def _sample(pictures: Tensor, at: Tensor) -> Tensor:
    """(C, N, P) values of (C, H, W) pictures at (N, P, 2) places, between pixels."""
    height, width = pictures.shape[1:]
    grid = (at + 0.5) * 2.0 / torch.tensor([width, height]) - 1.0
    return F.grid_sample(pictures[None], grid[None], padding_mode="border", align_corners=False)[0]
