"""8-bit pictures in files and as arrays, at smaller sizes, and the observers for whom they are simulated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.color import srgb
from ...core.color.matrices import check_simulation
from ...core.errors import InputError
from ...core.files.untrusted import replacing
from ...core.settings import Layer

Pixels = NDArray[np.uint8]

_LEVELS = 255
_FORMATS = {".png": "PNG", ".bmp": "BMP", ".jpg": "JPEG"}  # Blender's names
_JPEG_QUALITY = 88
_SIGNATURE_BYTES = 8  # of a PNG file, before its first chunk
_FRAMING_BYTES = 12  # of a chunk: length and type before its data, checksum behind
_TEXT_CHUNKS = (b"tEXt", b"zTXt", b"iTXt", b"tIME")


def read_picture(path: Path) -> Pixels:
    """(H, W, 3) pixels of an 8-bit file, from the top.

    Raises:
        InputError: there is no such picture, or it is damaged.
    """
    with _opened(path) as image:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        values = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
        pixels = values.reshape(height, width, image.channels)[::-1, :, :3]
        return np.round(pixels * _LEVELS).astype(np.uint8)


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height; errors as for `read_picture`."""
    with _opened(path) as image:
        return image.size[0], image.size[1]


@contextmanager
def _opened(path: Path) -> Iterator[bpy.types.Image]:
    remedy = "run the batch again"
    if not path.is_file():
        raise InputError("no such picture", where=path, remedy=remedy)
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        if not all(image.size):
            raise InputError("cannot be read as a picture", where=path, remedy=remedy)
        yield image
    finally:
        bpy.data.images.remove(image)


def write_picture(path: Path, pixels: Pixels) -> None:
    """Write (H, W, 3) `pixels` as PNG, BMP or JPEG, by the suffix of `path`; folders are made as needed.

    Raises:
        OSError: it cannot be written.
        RuntimeError: Blender could not write it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width, _ = pixels.shape
    image = bpy.data.images.new(path.stem, width, height, alpha=False)
    try:
        image.colorspace_settings.name = "Non-Color"
        values = np.ones((height, width, 4), np.float32)
        values[..., :3] = pixels[::-1] / np.float32(_LEVELS)
        image.pixels.foreach_set(values.ravel())
        with replacing(path) as temporary:
            image.filepath_raw, image.file_format = str(temporary), _FORMATS[path.suffix]
            image.save(quality=_JPEG_QUALITY)
    finally:
        bpy.data.images.remove(image)


def remove_texts(path: Path) -> None:
    """Take out of the PNG file `path` what was noted there: when, how long and under which name it was rendered.

    Pictures are the same files then wherever and whenever they are rendered.
    """
    content = path.read_bytes()
    kept = [chunk for chunk in _chunks(content) if chunk[4:8] not in _TEXT_CHUNKS]
    with replacing(path) as temporary:
        temporary.write_bytes(content[:_SIGNATURE_BYTES] + b"".join(kept))


def _chunks(content: bytes) -> Iterator[bytes]:
    """The chunks of a PNG file (ISO/IEC 15948, section 5.3)."""
    start = _SIGNATURE_BYTES
    while start < len(content):
        end = start + _FRAMING_BYTES + int.from_bytes(content[start : start + 4], "big")
        yield content[start:end]
        start = end


def downscale(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """`picture`, (H, W, 3) sRGB, `width` pixels wide: each pixel is the mean light of the area that it stands for.

    A picture that is not wider stays as it is.
    """
    height_before, width_before, _ = picture.shape
    if width_before <= width:
        return picture
    height = max(round(height_before * width / width_before), 1)
    light = srgb.decode(np.arange(_LEVELS + 1) / _LEVELS)[picture]
    rows = np.tensordot(_shares(height_before, height), light, axes=(1, 0))
    mean = _shares(width_before, width) @ rows
    return np.round(srgb.encode(np.clip(mean, 0.0, 1.0)) * _LEVELS).astype(np.uint8)


def _shares(before: int, after: int) -> NDArray[np.float64]:
    """(after, before) share of each pixel of a line in the pixels of a shorter one; rows add up to 1."""
    edges = np.linspace(0.0, before, after + 1)[:, None]
    pixels = np.arange(before)
    covered = np.clip(np.minimum(edges[1:], pixels + 1.0) - np.maximum(edges[:-1], pixels), 0.0, None)
    return covered / covered.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class Observer:
    """A kind of colour vision and the model that describes it; see `core.color.matrices`."""

    cvd: str
    severity: float
    model: str

    @classmethod
    def from_name(cls, name: str, model: str) -> Observer:
        """The observer for whom the layer `name` is, e.g. ``deutan-1.0``; Brettel's model where `model` has none.

        Raises:
            InputError: there is no such observer.
        """
        try:
            layer = Layer.from_name(name)
        except ValueError:
            raise InputError(f"'{name}' is no observer", remedy="name a type and a severity, e.g. deutan-1.0") from None
        model = "brettel" if (layer.cvd, model) == ("tritan", "vienot") else model
        check_simulation(layer.cvd, layer.severity, model)
        return cls(layer.cvd, layer.severity, model)
