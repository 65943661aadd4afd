"""What EXIF data say of a photograph: its colours where it has no ICC profile, and what it was taken with."""

from __future__ import annotations

import math
import struct
import warnings
from pathlib import Path

from PIL import Image
from PIL.WebPImagePlugin import WebPImageFile

_ORIENTATION = 0x0112
_EXIF, _INTEROPERABILITY = 0x8769, 0xA005  # the tags that lead to further tables
_COLOR_SPACE, _INDEX = 0xA001, 0x0001
SRGB, UNCALIBRATED = 1, 65535
"""Values of ColorSpace (EXIF 2.32, tag 40961)."""
_ADOBE_RGB = "R03"  # DCF 2.0 (JEITA CP-3461B): "DCF optional file", Adobe RGB (1998) with ColorSpace uncalibrated
_FORMATS = ("JPEG", "PNG", "TIFF")  # that carry EXIF data, of those that OpenImageIO reads
LENS_ATTRIBUTES = ("Exif:FocalLength", "Exif:FocalLengthIn35mmFilm", "Exif:DigitalZoomRatio")
"""As OpenImageIO calls the numbers of `name_lens`, in their order."""
DAMAGE: tuple[type[Exception], ...] = (
    *(OSError, ValueError, SyntaxError, RuntimeError, EOFError, IndexError, KeyError, TypeError),
    AttributeError,
    ZeroDivisionError,
    struct.error,
    Image.DecompressionBombError,
)
"""Whatever goes wrong in Pillow where data are damaged."""


def exif_of_webp(path: Path) -> bytes:
    """The raw EXIF data of a WebP, which OpenImageIO does not read; nothing where there are none or it is damaged."""
    try:
        with WebPImageFile(path) as picture:
            return bytes(picture.info.get("exif") or b"")
    except DAMAGE:
        return b""


def orientation_of(exif: bytes) -> int:
    """EXIF orientation as raw EXIF data have it; 1 (upright) where they say nothing that can be read."""
    try:
        tags = Image.Exif()
        tags.load(exif)
        return int(tags.get(_ORIENTATION, 1))
    except DAMAGE:
        return 1


def is_adobe_rgb(exif: bytes) -> bool:
    """Whether raw EXIF data say that colours are of Adobe RGB (1998), as cameras do."""
    try:
        tags = Image.Exif()
        tags.load(exif)
        return _says_adobe_rgb(tags)
    except DAMAGE:
        return False


def is_file_of_adobe_rgb(path: Path) -> bool:
    """The same of a file; OpenImageIO does not read the table in which it stands."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of size, which the caller looks at, and of damaged tables
            with Image.open(path, formats=_FORMATS) as picture:
                return _says_adobe_rgb(picture.getexif())
    except DAMAGE:
        return False


def _says_adobe_rgb(tags: Image.Exif) -> bool:
    index = tags.get_ifd(_INTEROPERABILITY).get(_INDEX, "")
    index = index.decode("ascii", "replace") if isinstance(index, bytes) else str(index)
    return tags.get_ifd(_EXIF).get(_COLOR_SPACE) == UNCALIBRATED and index.strip("\0 ") == _ADOBE_RGB


def mark_srgb(tags: Image.Exif) -> None:
    """Make the data say that colours are sRGB.

    Raises:
        One of `DAMAGE`.
    """
    further = tags.get_ifd(_EXIF)
    if further:
        further[_COLOR_SPACE] = SRGB
        further.pop(_INTEROPERABILITY, None)


def name_lens(make: str, model: str, focal: float, equivalent: float, zoom: float) -> str:
    """Camera and lens as a text to compare; empty where nothing is known.

    A digital zoom leaves the focal length as it is, and often the size of the picture; only the other two numbers tell.

    Args:
        focal: in mm; 0 or NaN is unknown, as for what follows.
        equivalent: the focal length of the same view on 35 mm film, in mm.
        zoom: the ratio of a digital zoom; 1 is none.
    """
    zoom = round(zoom, 2)  # a hundredth makes no other lens
    numbers = ((focal, "mm"), (equivalent, "mm on film"), (zoom if zoom != 1.0 else 0.0, "x zoom"))
    lens = [f"{number:g} {unit}" for number, unit in numbers if number and math.isfinite(number)]
    return " ".join(part for part in (make, model, *lens) if part)
