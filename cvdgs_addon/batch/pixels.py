"""8-bit pictures in files and as arrays. They get their names only when they are complete."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.files.untrusted import replacing

Pixels = NDArray[np.uint8]

_LEVELS = 255.0
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
