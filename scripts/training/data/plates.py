"""Plates in the manner of Ishihara: dots in which normal vision sees a figure and one type of deficiency does not.

Figure and ground lie on a confusion line, so through the simulation nothing but chance tells them apart. Every dot's
light is jittered, which hides the small difference in luminance that remains; the jitter is balanced between figure and
ground, so that it does not draw the figure itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from .fields import Colors, decode, encode, linear_to_lab, power_noise, simulated_lab
from .palettes import draw_confused_pair

SMALLEST_PLATE = 96
"""Pixels; below it dots are not dots any more."""

# What the plates promise, with room for rounding to bytes and for the jitter: see `draw_plate`.
_LEAST_CONTRAST, _MOST_SEEN = 26.0, 1.0
_CANVAS = 224  # pixels on which dots are packed, whatever the plate's size
_CANDIDATES = 700  # centres tried at once
_RADII = (0.030, 0.030, 0.022, 0.022, 0.016, 0.016, 0.012, 0.012)  # of dots, in plate sizes; largest first

_Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Plate:
    """A plate and what is drawn on it.

    Attributes:
        image: (H, W, 3) uint8 sRGB.
        figure, ground: (H, W) bool, the pixels that lie in dots of each.
    """

    image: NDArray[np.uint8]
    figure: _Mask
    ground: _Mask


def draw_plate(cvd: str, size: int, generator: np.random.Generator) -> Plate:
    """A plate that normal vision reads and a dichromat of type `cvd` does not.

    The mean colours of figure and ground differ by ΔE76 20 or more for normal vision and by less than 2 as the
    simulation shows them (Machado 2009, severity 1).

    Args:
        cvd: "protan", "deutan" or "tritan".
        size: height and width in pixels, `SMALLEST_PLATE` at least.
        generator: source of randomness.
    """
    if size < SMALLEST_PLATE:
        raise ValueError(f"a plate has at least {SMALLEST_PLATE} pixels a side, not {size}")
    while True:
        plate = _compose(cvd, size, generator)
        if _differs(plate, cvd):
            return plate


def _differs(plate: Plate, cvd: str) -> bool:
    """Whether a plate keeps its promise; rounding and jitter spoil about one in a hundred."""
    parts = [decode(plate.image[mask]) for mask in (plate.figure, plate.ground)]
    normal, seen = (
        np.linalg.norm(np.subtract(*(lab(part).mean(0) for part in parts)))
        for lab in (linear_to_lab, lambda part: simulated_lab(part, cvd))
    )
    return bool(normal >= 20.0 and seen < 2.0)


def _compose(cvd: str, size: int, generator: np.random.Generator) -> Plate:
    centers, radii = _pack(generator)
    shape = _FIGURES[list(_FIGURES)[generator.integers(len(_FIGURES))]]
    in_figure = _in_figure(shape, centers, generator)
    pair = draw_confused_pair(cvd, generator, _LEAST_CONTRAST, _MOST_SEEN, (35.0, 75.0))
    light = _balanced_jitter(in_figure, generator)
    # Light that would clip a channel would also tint it.
    room = 0.98 / pair.max()
    colors = pair[in_figure.astype(int)] * np.minimum(light, room)[:, None]
    return _paint(size, centers, radii, in_figure, colors, generator)


def _balanced_jitter(in_figure: _Mask, generator: np.random.Generator) -> Colors:
    """(N,) luminance factors, with the same distribution in the figure and on the ground."""
    spread = generator.uniform(0.12, 0.3)
    factors = np.empty(len(in_figure))
    for part in (in_figure, ~in_figure):
        count = int(part.sum())
        quantiles = (np.arange(count) + 0.5) / max(count, 1)
        factors[part] = np.exp(spread * (2.0 * generator.permutation(quantiles) - 1.0))
    return factors


def _pack(generator: np.random.Generator) -> tuple[Colors, Colors]:
    """(N, 2) centres (row, column) and (N,) radii of dots that do not touch, in plate sizes."""
    rows, columns = np.mgrid[:_CANVAS, :_CANVAS].astype(np.float32) + 0.5
    disc = np.hypot(rows - _CANVAS / 2, columns - _CANVAS / 2)
    round_plate = generator.random() < 0.75
    room = _CANVAS * 0.485 - disc if round_plate else np.full_like(disc, np.inf)
    occupied = np.zeros((_CANVAS, _CANVAS), bool)
    scale, gap = generator.uniform(0.85, 1.35) * _CANVAS, generator.uniform(0.3, 0.9)
    centers: list[NDArray] = []
    radii: list[NDArray] = []
    for share in _RADII:
        radius = share * scale
        free = np.minimum(distance_transform_edt(~occupied) if occupied.any() else np.inf, room)
        open_pixels = np.flatnonzero(free > radius + gap)
        chosen = generator.choice(open_pixels, min(_CANDIDATES, len(open_pixels)), replace=False)
        points = np.stack(np.divmod(chosen, _CANVAS), -1) + generator.random((len(chosen), 2))
        points = points[_apart(points, 2.0 * radius + gap)]
        centers.append(points)
        radii.append(np.full(len(points), radius) * generator.uniform(0.85, 1.0, len(points)))
        _occupy(occupied, points, radius)
    return np.concatenate(centers) / _CANVAS, np.concatenate(radii) / _CANVAS


def _apart(points: Colors, distance: float) -> NDArray[np.int64]:
    """Indices of points, taken greedily in order, that are at least `distance` from each other."""
    near = ((points[:, None] - points[None]) ** 2).sum(-1) < distance**2
    kept: list[int] = []
    blocked = np.zeros(len(points), bool)
    for index in range(len(points)):
        if not blocked[index]:
            kept.append(index)
            blocked |= near[index]
    return np.array(kept, np.int64)


def _occupy(occupied: _Mask, points: Colors, radius: float) -> None:
    reach = int(np.ceil(radius)) + 1
    offsets = np.moveaxis(np.mgrid[-reach : reach + 1, -reach : reach + 1], 0, -1).reshape(-1, 2)
    pixels = np.floor(points).astype(int)[:, None] + offsets
    inside = ((pixels + 0.5 - points[:, None]) ** 2).sum(-1) < radius**2
    inside &= ((pixels >= 0) & (pixels < _CANVAS)).all(-1)
    occupied[tuple(pixels[inside].T)] = True


def _paint(
    size: int, centers: Colors, radii: Colors, in_figure: _Mask, colors: Colors, generator: np.random.Generator
) -> Plate:
    background = _background(generator)
    image = np.broadcast_to(background.astype(np.float32), (size, size, 3)).copy()
    labels = np.zeros((size, size), np.uint8)
    shade = generator.uniform(0.0, 0.12)  # some printed dots have an uneven edge
    for (row, column), radius, member, color in zip(centers * size, radii * size, in_figure, colors, strict=True):
        top, left = max(int(row - radius - 1), 0), max(int(column - radius - 1), 0)
        bottom, right = int(row + radius + 2), int(column + radius + 2)
        window = image[top:bottom, left:right]
        y = np.arange(top, top + window.shape[0], dtype=np.float32)[:, None] + 0.5 - row
        x = np.arange(left, left + window.shape[1], dtype=np.float32)[None] + 0.5 - column
        distance = np.sqrt(y * y + x * x)
        cover = np.clip(radius + 0.5 - distance, 0.0, 1.0)[..., None]
        painted = color * (1.0 - shade * np.clip(distance / radius, 0.0, 1.0) ** 4)[..., None]
        window += (cover * (painted - window)).astype(np.float32)
        labels[top:bottom, left:right][distance <= radius - 0.5] = 2 if member else 1
    if generator.random() < 0.3:
        image *= 1.0 + 0.02 * power_noise(size, size, 0.5, generator)
    if generator.random() < 0.3:
        image = gaussian_filter(image, (0.5, 0.5, 0.0))
    return Plate(encode(image), labels == 2, labels == 1)


def _background(generator: np.random.Generator) -> Colors:
    """(3,) white, cream, grey or dark paper."""
    light = generator.choice([generator.uniform(0.7, 1.0), generator.uniform(0.1, 0.6), generator.uniform(0.0, 0.08)])
    return light * np.array([1.0, *np.sort(generator.uniform(0.85, 1.0, 2))[::-1]])


# Figures say which of (N, 2) points are in them: x to the right, y down, the plate's centre at 0 and its edge at 1.


def _strokes(points: Colors, lines: list[list[tuple[float, float]]], thickness: float) -> _Mask:
    """Points within `thickness` of polylines."""
    inside = np.zeros(len(points), bool)
    for line in lines:
        for start, end in zip(np.array(line[:-1]), np.array(line[1:]), strict=True):
            along = end - start
            share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
            inside |= np.linalg.norm(points - start - share[:, None] * along, axis=1) < thickness
    return inside


_DIGITS = {
    "0": [[(-0.35, -0.4), (0, -0.6), (0.35, -0.4), (0.35, 0.4), (0, 0.6), (-0.35, 0.4), (-0.35, -0.4)]],
    "1": [[(-0.2, -0.4), (0.05, -0.6), (0.05, 0.6)]],
    "2": [[(-0.35, -0.35), (-0.1, -0.6), (0.2, -0.6), (0.35, -0.3), (-0.35, 0.6), (0.4, 0.6)]],
    "3": [[(-0.35, -0.6), (0.3, -0.6), (0.0, -0.1), (0.3, 0.1), (0.3, 0.45), (0.0, 0.6), (-0.35, 0.5)]],
    "4": [[(0.2, 0.6), (0.2, -0.6), (-0.4, 0.2), (0.4, 0.2)]],
    "5": [[(0.35, -0.6), (-0.3, -0.6), (-0.3, -0.1), (0.1, -0.15), (0.35, 0.1), (0.3, 0.45), (0, 0.6), (-0.35, 0.5)]],
    "6": [[(0.25, -0.6), (-0.25, -0.1), (-0.35, 0.3), (-0.1, 0.6), (0.2, 0.6), (0.35, 0.3), (0.15, 0.0), (-0.3, 0.1)]],
    "7": [[(-0.4, -0.6), (0.4, -0.6), (-0.1, 0.6)]],
    "8": [
        [(0, -0.05), (-0.28, -0.25), (-0.2, -0.55), (0.2, -0.55), (0.28, -0.25), (0, -0.05)],
        [(0, -0.05), (-0.36, 0.2), (-0.25, 0.58), (0.25, 0.58), (0.36, 0.2), (0, -0.05)],
    ],
    "9": [
        [(0.3, -0.1), (-0.15, 0.0), (-0.35, -0.3), (-0.2, -0.6), (0.1, -0.6), (0.35, -0.3), (0.25, 0.1), (-0.2, 0.6)]
    ],
}


def _digit(points: Colors, generator: np.random.Generator) -> _Mask:
    return _strokes(points, _DIGITS[str(generator.integers(10))], generator.uniform(0.11, 0.16))


def _two_digits(points: Colors, generator: np.random.Generator) -> _Mask:
    thickness = generator.uniform(0.13, 0.17)
    left, right = ((points - [shift, 0.0]) * [1.5, 1.1] for shift in (-0.4, 0.4))
    first, second = generator.integers(0, 10, 2)
    return _strokes(left, _DIGITS[str(first)], thickness) | _strokes(right, _DIGITS[str(second)], thickness)


def _ring(points: Colors, generator: np.random.Generator) -> _Mask:
    """A Landolt ring: open or closed."""
    radius, angle = np.linalg.norm(points, axis=1), np.arctan2(points[:, 1], points[:, 0])
    opening = generator.choice([0.0, 0.35])
    return (np.abs(radius - 0.45) < generator.uniform(0.1, 0.16)) & (np.abs(angle) > opening)


def _cross(points: Colors, generator: np.random.Generator) -> _Mask:
    return _strokes(points, [[(-0.6, 0), (0.6, 0)], [(0, -0.6), (0, 0.6)]], generator.uniform(0.11, 0.18))


def _crescent(points: Colors, generator: np.random.Generator) -> _Mask:
    hole = np.linalg.norm(points - [generator.uniform(0.2, 0.4), 0.0], axis=1)
    return (np.linalg.norm(points, axis=1) < 0.65) & (hole > 0.5)


def _disc_or_square(points: Colors, generator: np.random.Generator) -> _Mask:
    order = generator.choice([1.0, 2.0, 8.0])
    return (np.abs(points) ** order).sum(1) < generator.uniform(0.4, 0.6) ** order


def _winding_path(points: Colors, generator: np.random.Generator) -> _Mask:
    bend = 0.35 * np.sin(points[:, 0] * generator.uniform(2.5, 5.0) + generator.uniform(0.0, 6.28))
    return np.abs(points[:, 1] - bend) < generator.uniform(0.1, 0.16)


_FIGURES: dict[str, Callable[[Colors, np.random.Generator], _Mask]] = {
    "digit": _digit,
    "two digits": _two_digits,
    "ring": _ring,
    "cross": _cross,
    "crescent": _crescent,
    "disc or square": _disc_or_square,
    "winding path": _winding_path,
}
_TURNED = ("ring", "cross", "crescent", "disc or square", "winding path")


def _in_figure(
    shape: Callable[[Colors, np.random.Generator], _Mask], centers: Colors, generator: np.random.Generator
) -> _Mask:
    """Which dots belong to the figure, of random size, place and, where it is no digit, orientation."""
    points = (centers[:, ::-1] * 2.0 - 1.0 - generator.uniform(-0.12, 0.12, 2)) / generator.uniform(0.85, 1.15)
    if shape in [_FIGURES[name] for name in _TURNED]:
        angle = generator.uniform(0.0, 2.0 * np.pi)
        points = points @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return shape(points, generator)
