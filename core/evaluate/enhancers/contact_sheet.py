"""Contact sheets: a few images as every method makes them, and below as the observer sees them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ...capture.images import downscale, fit_size
from ...color.simulation import simulate
from ...color.spaces import image_to_tensor, tensor_to_image
from ...images import to_bytes, write_png
from ...settings import Layer

Pixels = NDArray[np.uint8]

_TILE = 256  # pixels, longer side of an image
_GAP = 4
_LABEL_HEIGHT, _LABEL_SIZE = 22, 15


def write_contact_sheet(path: Path, images: Sequence[Mapping[str, Pixels]], observer: Layer, model: str) -> None:
    """Write a PNG with a column for each method and two rows for each image.

    Args:
        path: of the file.
        images: (H, W, 3) by the label of the method; every image in the same order of methods.
        observer: for whom the second row is simulated.
        model: of the simulation.
    """
    rows: list[list[Pixels]] = []
    for versions in images:
        rows += [list(versions.values()), [_seen(pixels, observer, model) for pixels in versions.values()]]
    strips = [np.concatenate([_tile(image) for image in row], 1) for row in rows]
    grid = np.concatenate(strips).astype(np.float32) / 255.0
    write_png(path, np.concatenate([_labels(list(images[0]), grid.shape[1]), grid]))


def _seen(pixels: Pixels, observer: Layer, model: str) -> Pixels:
    image = simulate(image_to_tensor(pixels), observer.cvd, observer.severity, model)
    return to_bytes(tensor_to_image(image))


def _labels(labels: Sequence[str], width: int) -> NDArray[np.float32]:
    """(H, width, 3) white strip with a text above each column."""
    canvas = oiio.ImageBuf(np.ones((_LABEL_HEIGHT, width, 3), np.float32))
    for column, label in enumerate(labels):
        left = column * (_TILE + _GAP) + _GAP
        oiio.ImageBufAlgo.render_text(canvas, left, _LABEL_SIZE, label, _LABEL_SIZE, "", (0.0, 0.0, 0.0))
    return np.asarray(canvas.get_pixels(oiio.FLOAT))[..., :3]


def _tile(image: Pixels) -> Pixels:
    """The image on a white square, with a gap to its right and below."""
    height, width = image.shape[:2]
    width, height = fit_size(width, height, _TILE)
    tile = np.full((_TILE + _GAP, _TILE + _GAP, 3), 255, np.uint8)
    tile[:height, :width] = downscale(image, width, height)
    return tile
