"""What a training picture shows and who looks at it: the kinds of image that can be drawn, and observers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....core.color.simulation import Observer
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


KIND_SHARES: Mapping[str, float] = {
    "tartan": 0.10,
    "stripes": 0.06,
    "checks": 0.07,
    "yarns": 0.06,
    "jacquard": 0.06,
    "print": 0.09,
    "board": 0.04,
    "cells": 0.04,
    "noise": 0.04,
    "leaves": 0.08,
    "foliage": 0.07,
    "still life": 0.07,
    "landscape": 0.05,
    "portrait": 0.04,
    "plate": 0.10,
    "mixture": 0.07,
}
"""How often each kind is drawn, in proportion: about half cloth, the rest plates and stand-ins for photographs."""

# Red-green deficiencies are what most users have; achromatopsia is rare, and little can be done for it.
_TYPES = {"protan": 0.32, "deutan": 0.36, "tritan": 0.22, "achromat": 0.10}
_MODELS = {"machado": 0.70, "brettel": 0.15, "vienot": 0.15}
_FULL_SEVERITY_SHARE = 0.45
_LEAST_SEVERITY = 0.2  # below it there is next to nothing to learn; the identity at 0 is built in elsewhere
_OBSERVERS_OF_CONFUSED_TYPE = 2


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


def draw_observers(count: int, confuses: str | None, generator: np.random.Generator) -> list[Observer]:
    """Who looks at an image; the first two have the deficiency that its colours confuse, if it has any."""
    observers = []
    for index in range(count):
        chosen = confuses if index < _OBSERVERS_OF_CONFUSED_TYPE else None
        cvd = chosen or str(generator.choice(list(_TYPES), p=list(_TYPES.values())))
        full = generator.random() < _FULL_SEVERITY_SHARE
        severity = 1.0 if full else round(float(generator.uniform(_LEAST_SEVERITY, 1.0)), 3)
        model = str(generator.choice(list(_MODELS), p=list(_MODELS.values())))
        if cvd == "tritan" and model == "vienot":  # which does not describe it
            model = "machado"
        observers.append(Observer(cvd, severity, model))
    return observers
