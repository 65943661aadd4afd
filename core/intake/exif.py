"""What EXIF data say of a photograph: its colours where it has no ICC profile, and what it was taken with."""

from __future__ import annotations

import math
import struct
import warnings
from pathlib import Path

from PIL import Image
from PIL.TiffImagePlugin import IFDRational
from PIL.WebPImagePlugin import WebPImageFile

_MAKE, _MODEL, _ORIENTATION = 0x010F, 0x0110, 0x0112
_EQUIVALENT = 0xA405
_LENS = (0x920A, _EQUIVALENT, 0xA404)  # the numbers of `name_lens`, in their order
_LONG = (0x927C, 0x9286)  # what a maker or a user has noted
_MOST_BYTES = 65_533  # in a JPEG, whose segments state their length in 16 bits
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


def _tags_of(exif: bytes) -> Image.Exif:
    """Raises one of `DAMAGE`."""
    tags = Image.Exif()
    tags.load(exif)
    return tags


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
        return int(_tags_of(exif).get(_ORIENTATION, 1))
    except DAMAGE:
        return 1


def is_adobe_rgb(exif: bytes) -> bool:
    """Whether raw EXIF data say that colours are of Adobe RGB (1998), as cameras do."""
    try:
        return _says_adobe_rgb(_tags_of(exif))
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


def _mark_srgb(tags: Image.Exif) -> None:
    further = tags.get_ifd(_EXIF)
    if further:
        further[_COLOR_SPACE] = SRGB
        further.pop(_INTEROPERABILITY, None)


def exif_for_jpeg(exif: bytes) -> bytes:
    """Raw EXIF data for an upright JPEG of sRGB; nothing where they are damaged.

    HEIC and AVIF may hold more than a JPEG can; then notes are left out, or else all but camera and lens.
    """
    try:
        tags = _tags_of(exif)
        tags[_ORIENTATION] = 1
        _mark_srgb(tags)
        written = tags.tobytes()
        if len(written) > _MOST_BYTES:
            for number in _LONG:
                tags.get_ifd(_EXIF).pop(number, None)
            written = tags.tobytes()
        if len(written) > _MOST_BYTES:
            written = _lens_alone(tags).tobytes()
    except DAMAGE:
        return b""
    return written if len(written) <= _MOST_BYTES else b""


def _lens_alone(tags: Image.Exif) -> Image.Exif:
    alone = Image.Exif()
    alone.update((number, tags[number]) for number in (_MAKE, _MODEL) if number in tags)
    further = tags.get_ifd(_EXIF)
    alone.get_ifd(_EXIF).update((number, further[number]) for number in _LENS if number in further)
    return alone


def exif_of_lens(make: str, model: str, focal: float, equivalent: float, zoom: float) -> bytes:
    """Raw EXIF data that say what `name_lens` is given, as far as it is known."""
    tags = Image.Exif()
    tags.update((number, text) for number, text in ((_MAKE, make), (_MODEL, model)) if text)
    numbers = zip(_LENS, (focal, equivalent, zoom), strict=True)
    known: dict[int, IFDRational | int] = {
        number: IFDRational(value) for number, value in numbers if value > 0.0 and math.isfinite(value)
    }
    if _EQUIVALENT in known:
        known[_EQUIVALENT] = round(equivalent)  # a whole number in EXIF data
    try:
        tags.get_ifd(_EXIF).update(known)
        return tags.tobytes()
    except DAMAGE:
        return b""


def taken_with(exif: bytes) -> str:
    """What raw EXIF data say, as `name_lens` has it."""
    try:
        tags = _tags_of(exif)
        make, model = (str(tags.get(number, "")).strip("\0 ") for number in (_MAKE, _MODEL))
        further = tags.get_ifd(_EXIF)
        focal, equivalent, zoom = (float(further.get(number) or 0.0) for number in _LENS)
    except DAMAGE:
        return ""
    return name_lens(make, model, focal, equivalent, zoom)


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
