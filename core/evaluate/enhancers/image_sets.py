"""The image sets on which enhancers are compared: folders of photographs, and plates and textiles drawn afresh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...capture.files import list_images
from ...capture.images import downscale, fit_size, read_pixels
from ...enhance.data.kinds import draw_image
from ...enhance.data.plates import draw_plate
from ...errors import InputError
from ..evaluation import spread

FRESH_SEED = 20_000_003
"""Where the seeds of plates and textiles begin that no training has drawn from; training counts up from small ones."""

PLATE_TYPES = ("protan", "deutan", "tritan")
TEXTILE_KINDS = ("tartan", "stripes", "checks", "yarns", "jacquard", "print")


@dataclass(frozen=True)
class TestImage:
    """One image of a set.

    Attributes:
        name: unique within the set.
        pixels: (H, W, 3) uint8 sRGB.
        cvd: the only type of deficiency that the image is about; None for any.
        figure, ground: (H, W) bool, the parts of a plate; None for other images.
    """

    __test__ = False  # its name is no invitation to pytest

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
        photographs: whether these are photographs, over which the headline figures are.
    """

    name: str
    images: tuple[TestImage, ...]
    photographs: bool = False


def read_photographs(name: str, folder: Path, size: int, limit: int | None = None) -> ImageSet:
    """The photographs of a folder, longer side at most `size` pixels; at most `limit` of them, evenly spread.

    Raises:
        InputError: the folder has no images, or one cannot be read.
    """
    files = list_images(folder) if folder.is_dir() else []
    if not files:
        raise InputError("no photographs are there", where=folder, remedy="name a folder of images")
    chosen = spread(range(len(files)), limit or len(files))
    images = []
    for index in chosen:
        pixels, _ = read_pixels(folder / files[index], upright=True)
        height, width = pixels.shape[:2]
        images.append(TestImage(files[index], downscale(pixels, *fit_size(width, height, size))))
    return ImageSet(name, tuple(images), photographs=True)


def fresh_plates(count: int, size: int, types: Sequence[str] = PLATE_TYPES) -> ImageSet:
    """`count` plates for each type of deficiency that training has never drawn, `size` pixels a side."""
    images = []
    for cvd in types:
        for number in range(count):
            plate = draw_plate(cvd, size, _generator(PLATE_TYPES.index(cvd), number))
            images.append(TestImage(f"{cvd}-{number:02d}", plate.image, cvd, plate.figure, plate.ground))
    return ImageSet("plates", tuple(images))


def fresh_textiles(count: int, size: int) -> ImageSet:
    """`count` textiles that training has never drawn, of all kinds by turns."""
    images = []
    for number in range(count):
        kind = TEXTILE_KINDS[number % len(TEXTILE_KINDS)]
        pixels = draw_image(kind, size, size, _generator(len(PLATE_TYPES), number))
        images.append(TestImage(f"{number:02d}-{kind}", pixels))
    return ImageSet("textiles", tuple(images))


def _generator(stream: int, number: int) -> np.random.Generator:
    return np.random.default_rng([FRESH_SEED, stream, number])
