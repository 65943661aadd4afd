"""What a sample of the paired dataset shows: a drawn image or a piece of a photograph, and who looks at it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.capture.files import list_images
from ....core.capture.images import downscale, read_pixels
from ....core.color.simulation import Observer
from ....core.errors import InputError
from .kinds import draw

PHOTOGRAPH = "photograph"
"""The kind of a sample whose input is a piece of a photograph."""

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
class Input:
    """The input of a sample.

    Attributes:
        image: (H, W, 3) uint8 sRGB.
        kind: what was drawn, or `PHOTOGRAPH`.
        confuses: the type of deficiency that its colours were chosen for, or None.
        source: the photograph's name, or None.
    """

    image: NDArray[np.uint8]
    kind: str
    confuses: str | None = None
    source: str | None = None


@dataclass(frozen=True)
class Photographs:
    """Photographs in folders, in a fixed order.

    Attributes:
        paths: of the files.
        names: folder name and path below it, and the size in bytes: what tells whether they are still the same.
    """

    paths: tuple[Path, ...] = ()
    names: tuple[str, ...] = ()

    @classmethod
    def find(cls, folders: tuple[str, ...]) -> Photographs:
        """All images in and below the folders.

        Raises:
            InputError: a folder is missing or holds no image.
        """
        paths: list[Path] = []
        names: list[str] = []
        for folder in map(Path, folders):
            found = list_images(folder) if folder.is_dir() else []
            if not found:
                raise InputError("there is no folder of images", where=folder, remedy="give one that holds photographs")
            paths += [folder / name for name in found]
            names += [f"{folder.resolve().name}/{name} ({(folder / name).stat().st_size} bytes)" for name in found]
        return cls(tuple(paths), tuple(names))


def draw_input(
    size: int,
    kind_shares: Mapping[str, float],
    photographs: Photographs,
    photograph_share: float,
    generator: np.random.Generator,
) -> Input:
    """An image of `size` pixels a side."""
    if photographs.paths and generator.random() < photograph_share:
        chosen = int(generator.integers(len(photographs.paths)))
        image = cut_photograph(photographs.paths[chosen], size, generator)
        return Input(image, PHOTOGRAPH, source=photographs.names[chosen])
    shares = np.array(list(kind_shares.values()), np.float64)
    kind = str(generator.choice(list(kind_shares), p=shares / shares.sum()))
    drawing = draw(kind, size, size, generator)
    return Input(drawing.image, kind, drawing.confuses)


def cut_photograph(path: Path, size: int, generator: np.random.Generator) -> NDArray[np.uint8]:
    """(size, size, 3) a random square of a photograph, at a random scale between its own and all of it."""
    image, alpha = read_pixels(path, upright=True)
    if alpha is not None:
        cover = alpha[..., None].astype(np.float32) / 255.0
        image = np.round(255.0 + cover * (image - 255.0)).astype(np.uint8)
    shorter = min(image.shape[:2])
    side = round(float(np.exp(generator.uniform(np.log(min(size, shorter)), np.log(shorter)))))
    top, left = (int(generator.integers(0, length - side + 1)) for length in image.shape[:2])
    return downscale(np.ascontiguousarray(image[top : top + side, left : left + side]), size, size)


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
