"""Colours for the training images: half of the palettes hold what an observer confuses, half what scenes are made of.

Colours that differ along the direction which a dichromat's matrix nearly loses look alike to that observer and may be
far apart for normal vision: they are what an enhancer has to learn about. The other half teaches it what may stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .fields import Colors, lch_to_linear, linear_to_lab, simulated_lab

PALETTE_SIZE = 12
"""Colours in every palette; the first ones matter most."""

CONFUSING_SHARE = 0.5
"""Share of palettes drawn along confusion lines."""

# Protan and deutan are ninety-nine in a hundred cases of inherited deficiency, but the enhancer serves all three alike.
_CONFUSED_TYPES = {"protan": 0.37, "deutan": 0.38, "tritan": 0.25}

_CANDIDATES = 1024  # pairs tried at once; about one in three hundred of the tritan ones is as good as plates need
_STEP = 1e-4  # of finite differences, in linear sRGB
_REGULARISER = 1e-9  # of singular metrics, whose other entries are about 1e4


@dataclass(frozen=True)
class Palette:
    """Colours that go together.

    Attributes:
        colors: (PALETTE_SIZE, 3) linear sRGB in [0, 1].
        confuses: the type of deficiency to which the first colours look alike, or None.
    """

    colors: Colors
    confuses: str | None = None


def draw_palette(generator: np.random.Generator, confuses: str | None = None) -> Palette:
    """A random palette; with `confuses` ("protan", "deutan", "tritan") certainly one along its confusion lines."""
    if confuses is None and generator.random() < CONFUSING_SHARE:
        confuses = str(generator.choice(list(_CONFUSED_TYPES), p=list(_CONFUSED_TYPES.values())))
    if confuses is None:
        return Palette(_natural(PALETTE_SIZE, generator))
    return Palette(_confusing(PALETTE_SIZE, confuses, generator), confuses)


def draw_confused_pair(
    cvd: str,
    generator: np.random.Generator,
    least_contrast: float = 15.0,
    most_seen: float = 3.0,
    lightness: tuple[float, float] = (25.0, 85.0),
) -> Colors:
    """(2, 3) linear colours on a confusion line of `cvd`.

    Args:
        cvd: "protan", "deutan" or "tritan".
        generator: source of randomness.
        least_contrast: ΔE76 of the two for normal vision, at least.
        most_seen: ΔE76 of the two as the dichromat sees them (Machado 2009, severity 1), at most.
        lightness: CIELAB lightness between which the line's anchor lies.
    """
    while True:
        anchor = _random_lch(lightness, (0.0, 90.0), _CANDIDATES, generator)
        lost = confusion_directions(anchor, cvd)
        steps = generator.uniform(0.1, 1.0, (2, _CANDIDATES))
        first = anchor - (steps[0] * _reach(anchor, -lost))[:, None] * lost
        second = anchor + (steps[1] * _reach(anchor, lost))[:, None] * lost
        contrast = np.linalg.norm(linear_to_lab(first) - linear_to_lab(second), axis=-1)
        seen = np.linalg.norm(simulated_lab(first, cvd) - simulated_lab(second, cvd), axis=-1)
        usable = np.flatnonzero((contrast >= least_contrast) & (seen <= most_seen))
        if len(usable):
            chosen = int(generator.choice(usable))
            pair = np.stack([first[chosen], second[chosen]])
            return np.clip(pair[generator.permutation(2)], 0.0, 1.0)


def confusion_directions(colors: Colors, cvd: str) -> Colors:
    """(N, 3) unit vectors in linear sRGB along which each of (N, 3) colours changes least for a dichromat.

    Least in proportion to the change for normal vision, both as ΔE76: the solution of a generalised eigenvalue problem
    of the two Jacobians. For protan and deutan it is the null vector of the matrix; Machado's matrix for tritan has
    none, and what it loses depends on the colour.
    """
    normal = _jacobian(linear_to_lab, colors)
    seen = _jacobian(lambda moved: simulated_lab(moved, cvd), colors)
    metrics = [np.swapaxes(jacobian, -1, -2) @ jacobian for jacobian in (seen, normal)]
    values, vectors = np.linalg.eig(np.linalg.solve(metrics[0] + _REGULARISER * np.eye(3), metrics[1]))
    least_seen = vectors.real[np.arange(len(colors)), :, values.real.argmax(-1)]
    return least_seen / np.linalg.norm(least_seen, axis=-1, keepdims=True)


def _jacobian(function: Callable[[Colors], Colors], colors: Colors) -> NDArray[np.float64]:
    """(N, 3, 3) central differences of a map of (N, 3) colours."""
    steps = _STEP * np.eye(3)
    return np.stack([(function(colors + step) - function(colors - step)) / (2.0 * _STEP) for step in steps], -1)


def _reach(colors: Colors, direction: Colors) -> Colors:
    """(N,) how far (N, 3) colours can move along `direction` before they leave the gamut."""
    room = np.where(direction > 0.0, 1.0 - colors, colors)
    return np.min(room / np.maximum(np.abs(direction), 1e-9), axis=-1)


def _confusing(count: int, cvd: str, generator: np.random.Generator) -> Colors:
    """One to three confused groups, the colours between their ends, and a natural remainder."""
    colors: list[Colors] = []
    for _ in range(generator.integers(1, 4)):
        # Most confused colours of real scenes are neither far apart nor quite equal to the observer.
        pair = draw_confused_pair(cvd, generator, generator.uniform(10.0, 30.0), generator.uniform(1.5, 6.0))
        if generator.random() < 0.4:
            between = pair[0] + generator.uniform(0.3, 0.7) * (pair[1] - pair[0])
            pair = np.vstack([pair, between])
        if generator.random() < 0.3:
            pair = np.clip(pair * generator.uniform(0.8, 1.25, (len(pair), 1)), 0.0, 1.0)
        colors.extend(pair)
    rest = _natural(count, generator)
    return np.array([*colors, *rest])[:count]


def _natural(count: int, generator: np.random.Generator) -> Colors:
    names = list(_NATURAL)
    style = _NATURAL[names[generator.integers(len(names))]]
    return style(count, generator)


def _random_lch(
    lightness: tuple[float, float], chroma: tuple[float, float], count: int, generator: np.random.Generator
) -> Colors:
    hue = generator.uniform(0.0, 2.0 * np.pi, count)
    return lch_to_linear(generator.uniform(*lightness, count), generator.uniform(*chroma, count), hue)


def _analogous(count: int, generator: np.random.Generator) -> Colors:
    hue = generator.uniform(0.0, 2.0 * np.pi) + generator.normal(0.0, 0.35, count)
    return lch_to_linear(generator.uniform(20.0, 90.0, count), generator.uniform(8.0, 65.0, count), hue)


def _complementary(count: int, generator: np.random.Generator) -> Colors:
    hue = generator.uniform(0.0, 2.0 * np.pi) + np.pi * generator.integers(0, 2, count)
    hue = hue + generator.normal(0.0, 0.2, count)
    return lch_to_linear(generator.uniform(20.0, 85.0, count), generator.uniform(15.0, 70.0, count), hue)


def _greys(count: int, generator: np.random.Generator) -> Colors:
    chroma = np.where(generator.random(count) < 0.12, 60.0, generator.uniform(0.0, 4.0, count))
    return lch_to_linear(generator.uniform(4.0, 97.0, count), chroma, generator.uniform(0.0, 2.0 * np.pi, count))


def _earth(count: int, generator: np.random.Generator) -> Colors:
    """Browns, ochres, olives and brick reds: what undyed and plant-dyed cloth, soil and wood have."""
    hue = np.radians(generator.uniform(25.0, 120.0, count))
    return lch_to_linear(generator.uniform(15.0, 80.0, count), generator.uniform(6.0, 48.0, count), hue)


def _skin_and_whites(count: int, generator: np.random.Generator) -> Colors:
    return np.where(generator.random((count, 1)) < 0.6, skin_tones(count, generator), whites(count, generator))


def skin_tones(count: int, generator: np.random.Generator) -> Colors:
    """(N, 3) linear colours of human skin: CIELAB hue 35 to 70 degrees, lightness and chroma going together."""
    lightness = generator.uniform(28.0, 80.0, count)
    chroma = generator.normal(24.0, 4.0, count) - 0.1 * np.abs(lightness - 58.0)
    return lch_to_linear(lightness, np.maximum(chroma, 6.0), np.radians(generator.uniform(35.0, 70.0, count)))


def whites(count: int, generator: np.random.Generator) -> Colors:
    """(N, 3) linear whites and near-whites."""
    hue = generator.uniform(0.0, 2.0 * np.pi, count)
    return lch_to_linear(generator.uniform(85.0, 99.0, count), generator.uniform(0.0, 5.0, count), hue)


def foliage(count: int, generator: np.random.Generator) -> Colors:
    """(N, 3) linear greens of plants: CIELAB hue 105 to 145 degrees."""
    hue = np.radians(generator.normal(122.0, 10.0, count))
    return lch_to_linear(generator.uniform(12.0, 72.0, count), generator.uniform(12.0, 58.0, count), hue)


def fruits(count: int, generator: np.random.Generator) -> Colors:
    """(N, 3) linear colours of ripe and unripe fruit and of flowers: red to yellow, some green, purple or white."""
    degrees = np.where(generator.random(count) < 0.75, generator.uniform(22.0, 95.0, count), 0.0)
    others = generator.choice([115.0, 125.0, 330.0, 0.0, 305.0], count)
    hue = np.radians(np.where(degrees > 0.0, degrees, others + generator.normal(0.0, 6.0, count)))
    return lch_to_linear(generator.uniform(28.0, 80.0, count), generator.uniform(40.0, 90.0, count), hue)


_NATURAL: dict[str, Callable[[int, np.random.Generator], Colors]] = {
    "muted": partial(_random_lch, (15.0, 88.0), (4.0, 32.0)),
    "any": partial(_random_lch, (8.0, 96.0), (0.0, 90.0)),
    "saturated": partial(_random_lch, (30.0, 85.0), (80.0, 140.0)),
    "analogous": _analogous,
    "complementary": _complementary,
    "greys": _greys,
    "earth": _earth,
    "skin and whites": _skin_and_whites,
}
