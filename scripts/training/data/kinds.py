"""The kinds of image that can be drawn, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import patches, prints, scenes, weaves
from .fields import relief, resize
from .palettes import Palette, draw_palette
from .plates import SMALLEST_PLATE, draw_plate

SMALLEST_IMAGE = 32
"""Pixels a side; below it no kind can be recognised."""

PLATE = "plate"
MIXTURE = "mixture"

Pixels = NDArray[np.uint8]

_DRAW: dict[str, Callable[[int, int, Palette, np.random.Generator], Pixels]] = {
    "tartan": weaves.draw_tartan,
    "stripes": weaves.draw_stripes,
    "checks": weaves.draw_checks,
    "yarns": weaves.draw_yarns,
    "jacquard": weaves.draw_jacquard,
    "print": prints.draw_print,
    "board": patches.draw_board,
    "cells": patches.draw_cells,
    "noise": patches.draw_noise,
    "leaves": patches.draw_leaves,
    "foliage": scenes.draw_foliage,
    "still life": scenes.draw_still_life,
    "landscape": scenes.draw_landscape,
    "portrait": scenes.draw_portrait,
}

KINDS = (*_DRAW, PLATE, MIXTURE)
"""Names that `draw_image` knows."""


@dataclass(frozen=True)
class Drawing:
    """A drawn image.

    Attributes:
        image: (H, W, 3) uint8 sRGB.
        confuses: the type of deficiency whose confusion lines gave the colours, or None.
    """

    image: Pixels
    confuses: str | None


def draw_image(kind: str, height: int, width: int, generator: np.random.Generator) -> Pixels:
    """(H, W, 3) uint8 sRGB image of one of `KINDS`; what is in it follows from the generator alone."""
    return draw(kind, height, width, generator).image


def draw(kind: str, height: int, width: int, generator: np.random.Generator, confuses: str | None = None) -> Drawing:
    """As `draw_image`, with the type of deficiency that its colours were chosen for.

    Args:
        kind: one of `KINDS`.
        height, width: in pixels, `SMALLEST_IMAGE` at least.
        generator: source of randomness.
        confuses: "protan", "deutan" or "tritan" for colours that this type confuses; None leaves it to chance.
    """
    if kind not in KINDS:
        raise ValueError(f"{kind!r} is not a kind of image; there are {', '.join(KINDS)}")
    if min(height, width) < SMALLEST_IMAGE:
        raise ValueError(f"images have at least {SMALLEST_IMAGE} pixels a side, not {height} x {width}")
    if kind == PLATE:
        return _draw_plate(height, width, generator, confuses)
    if kind == MIXTURE:
        return _draw_mixture(height, width, generator, confuses)
    palette = draw_palette(generator, confuses)
    return Drawing(_DRAW[kind](height, width, palette, generator), palette.confuses)


def _draw_plate(height: int, width: int, generator: np.random.Generator, confuses: str | None) -> Drawing:
    cvd = confuses or str(generator.choice(["protan", "deutan", "tritan"]))
    size = max(height, width, SMALLEST_PLATE)
    image = draw_plate(cvd, size, generator).image
    if max(height, width) < size:
        scale = max(height, width) / size
        image = np.round(resize(image, round(size * scale), round(size * scale))).clip(0, 255).astype(np.uint8)
    top, left = (image.shape[0] - height) // 2, (image.shape[1] - width) // 2
    return Drawing(np.ascontiguousarray(image[top : top + height, left : left + width]), cvd)


def _draw_mixture(height: int, width: int, generator: np.random.Generator, confuses: str | None) -> Drawing:
    """Two kinds side by side, along a straight or a winding border."""
    names = [str(name) for name in generator.choice(list(_DRAW), 2, replace=False)]
    first, second = (draw(name, height, width, generator, confuses) for name in names)
    y, x = np.linspace(-1.0, 1.0, height)[:, None], np.linspace(-1.0, 1.0, width)[None]
    angle = generator.uniform(0.0, 2.0 * np.pi)
    border = np.cos(angle) * x + np.sin(angle) * y + generator.uniform(-0.4, 0.4)
    border = border + generator.choice([0.0, 0.3]) * relief(height, width, 0.1 * min(height, width), generator)
    return Drawing(np.where((border > 0.0)[..., None], first.image, second.image), first.confuses or second.confuses)
