"""8-bit PNG and JPEG files of the pipeline's own images."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray
from PIL import Image

_PNG_END = b"\0\0\0\0IEND\xae\x42\x60\x82"  # the last chunk: length, type, checksum
_COMPRESSION = 4  # of zlib's 9; half the time of the default for 3 % more bytes


def to_bytes(image: NDArray) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 from float sRGB in [0, 1] (clipped, rounded); uint8 passes through."""
    if image.dtype == np.uint8:
        return image
    return np.round(np.clip(image, 0.0, 1.0) * 255.0).astype(np.uint8)


def write_png(path: Path, image: NDArray, alpha: NDArray[np.uint8] | None = None) -> None:
    """Write an (H, W, 3) image, float sRGB in [0, 1] or uint8; folders are made as needed.

    Args:
        alpha: (H, W) coverage, written as straight alpha.

    Raises:
        OSError: it could not be written whole.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = to_bytes(image) if alpha is None else np.dstack([to_bytes(image), alpha])
    specification = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.UINT8)
    specification.attribute("oiio:ColorSpace", "sRGB")
    specification.attribute("oiio:UnassociatedAlpha", 1)
    specification.attribute("png:compressionLevel", _COMPRESSION)
    output = oiio.ImageOutput.create("png")
    written = output.open(str(path), specification) and output.write_image(np.ascontiguousarray(pixels))
    if not (output.close() and written):
        raise OSError(errno.EIO, output.geterror() or "the image could not be written", str(path))
    # OpenImageIO reports nothing when the disk is full; the file then lacks its end.
    if not _ends_with(path, _PNG_END):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def write_jpeg(path: Path, image: NDArray[np.uint8], quality: int, *, full_chroma: bool = True) -> None:
    """Write an (H, W, 3) image into an existing folder; the file's name may end in anything.

    Args:
        quality: 0 to 100.
        full_chroma: keep the colours at full resolution; cameras keep a quarter of them.

    Raises:
        OSError: it could not be written.
    """
    # OpenImageIO's libjpeg ends the whole process when the disk is full; what Pillow writes is the same otherwise.
    Image.fromarray(image).save(path, "JPEG", quality=quality, subsampling="4:4:4" if full_chroma else "4:2:0")


def _ends_with(path: Path, ending: bytes) -> bool:
    with open(path, "rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(file.tell() - len(ending), 0))
        return file.read(len(ending)) == ending


def read_png(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 of a file that `write_png` or `write_jpeg` wrote.

    Raises:
        OSError: it could not be read.
    """
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise OSError(errno.EIO, oiio.geterror() or "could not be read", str(path))
    pixels = source.read_image(0, 0, 0, 3, oiio.UINT8)
    source.close()
    if pixels is None:
        raise OSError(errno.EIO, source.geterror() or "could not be read", str(path))
    return pixels
