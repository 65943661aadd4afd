"""The image sets on which enhancers are compared: folders of photographs, and newly drawn plates and textiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.capture.files import list_images
from ....core.capture.images import read_pixels
from ....core.capture.scaling import downscale, fit_size
from ....core.errors import InputError
from ....core.intake.sampling import evenly_spread
from ...training.data.kinds import draw_image
from ...training.data.plates import draw_plate

FRESH_SEED = 20_000_003
"""First seed of plates and textiles that no training has seen; training counts up from small ones."""

PLATE_TYPES = ("protan", "deutan", "tritan")
TEXTILE_KINDS = ("tartan", "stripes", "checks", "yarns", "jacquard", "print")


@dataclass(frozen=True)
class TestImage:
    """One image of a set.

    Attributes:
        name: unique within the set.
        pixels: (H, W, 3) uint8 sRGB.
        cvd: the only type of deficiency that the image concerns; None for any.
        figure, ground: (H, W) bool, the parts of a plate; None for other images.
    """

    __test__ = False  # not a test class, whatever pytest thinks of its name

    name: str
    pixels: NDArray[np.uint8]
    cvd: str | None = None
    figure: NDArray[np.bool_] | None = None
    ground: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class ImageSet:
    """Images that are averaged together.

    Attributes:
        name: in tables and file names.
        images: the images.
        photographs: whether these are photographs, which the headline figures are about.
    """

    name: str
    images: tuple[TestImage, ...]
    photographs: bool = False


def read_photographs(name: str, folder: Path, size: int, limit: int | None = None) -> ImageSet:
    """The photographs of a folder, longer side at most `size` pixels; at most `limit` of them, evenly spread.

    Raises:
        InputError: the folder has no images, or one cannot be read.
    """
    images = tuple(TestImage(file, pixels) for file, pixels in read_images(folder, size, limit).items())
    return ImageSet(name, images, photographs=True)


def read_images(folder: Path, size: int, limit: int | None = None) -> dict[str, NDArray[np.uint8]]:
    """The images of a folder by file name, in natural order; arguments and errors as for `read_photographs`."""
    files = list_images(folder) if folder.is_dir() else []
    if not files:
        raise InputError("no photographs found", where=folder, remedy="give a folder of photographs")
    images = {}
    for index in evenly_spread(range(len(files)), limit or len(files)):
        pixels, _ = read_pixels(folder / files[index], upright=True)
        height, width = pixels.shape[:2]
        images[files[index]] = downscale(pixels, *fit_size(width, height, size))
    return images


def fresh_plates(count: int, size: int, types: Sequence[str] = PLATE_TYPES) -> ImageSet:
    """`count` new plates for each type of deficiency, `size` pixels a side.

    Raises:
        InputError: there are no plates for a type.
    """
    if count and (unknown := sorted(set(types) - set(PLATE_TYPES))):
        remedy = f"use {', '.join(PLATE_TYPES)}, or --plates 0"
        raise InputError(f"there are no plates for type '{unknown[0]}'", where="--cvd", remedy=remedy)
    images = []
    for cvd in types:
        for number in range(count):
            plate = draw_plate(cvd, size, _generator(PLATE_TYPES.index(cvd), number))
            images.append(TestImage(f"{cvd}-{number:02d}", plate.image, cvd, plate.figure, plate.ground))
    return ImageSet("plates", tuple(images))


def fresh_textiles(count: int, size: int) -> ImageSet:
    """`count` new textiles, cycling through all kinds."""
    images = []
    for number in range(count):
        kind = TEXTILE_KINDS[number % len(TEXTILE_KINDS)]
        pixels = draw_image(kind, size, size, _generator(len(PLATE_TYPES), number))
        images.append(TestImage(f"{number:02d}-{kind}", pixels))
    return ImageSet("textiles", tuple(images))


def _generator(stream: int, number: int) -> np.random.Generator:
    return np.random.default_rng([FRESH_SEED, stream, number])
