"""Photographs: headers, and pixels as display-referred sRGB. OpenImageIO reads most, `intake` the others."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray
from PIL.JpegImagePlugin import JpegImageFile

from ..color.profiles import can_convert, convert_to_srgb
from ..errors import InputError
from ..files.untrusted import opened
from ..intake.exif import DAMAGE, LENS_ATTRIBUTES, exif_of_webp, name_lens, orientation_of, taken_with
from ..intake.heif import read_heif, read_heif_header
from ..intake.kinds import kind_of, video_as_photograph
from ..intake.raw import Development, read_raw, read_raw_header
from .channels import opaque_or, straight_srgb
from .specs import (
    attribute,
    color_profile,
    is_filling,
    is_linear,
    is_named_srgb,
    is_premultiplied,
    readable,
)

# Above every camera on sale (the largest sensors have 151 MP, 14,204 px a side), and 600 MB when decoded.
MAX_SIDE = 16_384
MAX_MEGAPIXELS = 200
# Of the decoded pixels with all their channels: four of 8 bits at the most megapixels, or 50 megapixels of
# floating-point RGBA. With a copy of each channel, reading any image stays below 3 GiB (tests/fuzz/test_memory.py).
MAX_DECODED_BYTES = 4 * MAX_MEGAPIXELS * 1_000_000
# Of a file: no format is larger than its pixels by more than a few headers.
MAX_FILE_BYTES = 2 * MAX_DECODED_BYTES
# Below this no training view holds a patch that a loss or a metric could use (SSIM looks at 11 x 11).
MIN_SIDE = 16

# EXIF 2.32, tag 274: what turns the stored image upright - flip the rows, flip the columns, then transpose.
_ORIENTATION_STEPS = {
    1: (False, False, False),
    2: (False, True, False),
    3: (True, True, False),
    4: (True, False, False),
    5: (False, False, True),
    6: (True, False, True),
    7: (True, True, True),
    8: (False, True, True),
}
_COPY_AGAIN = "copy or export the image again"
_EXPORT_PLAIN = "export it as PNG, JPEG or TIFF"
_CONVERT = "convert it to RGB (sRGB)"
# First bytes of PNG, JPEG, TIFF, BigTIFF, OpenEXR, BMP, Radiance and the family of PPM.
_SIGNATURES = (
    b"\x89PNG\r\n\x1a\n",
    b"\xff\xd8\xff",
    b"II*\0",
    b"MM\0*",
    b"II+\0",
    b"MM\0+",
    b"\x76\x2f\x31\x01",
    b"BM",
    b"#?R",
    *(f"P{kind}".encode() for kind in "123456fF"),
)
_SIGNATURE_BYTES = 32
_UNREADABLE = "no readable error message"  # it quotes bytes of the file that are not text
# What libjpeg says of damaged pixels, which Pillow does not mind. Bytes too many are no damage before a table, but they
# are where coded data start again.
_LOST_PIXELS = re.compile(r"premature end of data|bad \w+ code|before marker 0xd[0-7]|instead of RST")

_Pixel = TypeVar("_Pixel", np.uint8, np.bool_)

# OpenImageIO's own check, which comes before its readers make room for anything.
oiio.attribute("limits:imagesize_MB", 2 * MAX_DECODED_BYTES // 1_000_000)


@dataclass(frozen=True)
class ImageHeader:
    """What an image file says about itself.

    Attributes:
        width, height: in pixels, as stored.
        orientation: EXIF orientation, 1 (upright) to 8.
        color_profile: description of an embedded ICC profile, or what EXIF data say; an empty string where neither is
            there, or EXIF data say that colours are sRGB.
        bits: of a channel.
        converts: whether `read_pixels` makes colours of that profile sRGB.
        taken_with: what EXIF data say of camera, lens and zoom, as a text to compare; empty where they say nothing.
        has_pages: whether it is but the first of several pictures of this size.
    """

    width: int
    height: int
    orientation: int
    color_profile: str = ""
    bits: int = 8
    taken_with: str = ""
    converts: bool = False
    has_pages: bool = False

    @property
    def upright_size(self) -> tuple[int, int]:
        """(width, height) after the EXIF orientation is applied."""
        transposed = _ORIENTATION_STEPS[self.orientation][2]
        return (self.height, self.width) if transposed else (self.width, self.height)

    @property
    def is_foreign(self) -> bool:
        """Whether colours are said to be of a space that is not sRGB, and cannot be made so."""
        return bool(self.color_profile) and not (self.converts or is_named_srgb(self.color_profile))


def read_header(path: Path, *, min_side: int = MIN_SIDE) -> ImageHeader:
    """Read size and orientation without the pixels.

    Raises:
        InputError: not an image, beyond `MAX_SIDE` or `MAX_MEGAPIXELS`, below `min_side`, or CMYK or Lab.
    """
    kind = _kind(path)
    if kind:
        return _read_foreign_header(path, kind, min_side)
    with _opened(path) as file:
        spec = file.spec()
        _check_header(spec, path, min_side)
        described, profile = color_profile(spec, path)
        exif = _further_exif(file, path)
        return ImageHeader(
            spec.width,
            spec.height,
            _orientation(spec, exif),
            described,
            # Fewer than a format's whole bytes (PNG palettes, bitmaps) are reported apart from the decoded type.
            max(spec.get_int_attribute("oiio:BitsPerSample", 0), 8 * spec.format.size()),
            taken_with(exif) if exif else _taken_with(spec),
            can_convert(profile),
            _has_pages(file, spec.width, spec.height),
        )


def has_one_float_channel(path: Path) -> bool:
    """Whether an image is of one floating-point number a pixel, as depth maps are; not where it cannot be read."""
    try:
        if _kind(path):
            return False
        with _opened(path) as file:
            spec = file.spec()
            return spec.nchannels == 1 and is_linear(spec)
    except InputError:  # whoever needs the image says what is wrong with it
        return False


def _kind(path: Path) -> str:
    """ "heif", "avif", "raw", or "" for what OpenImageIO reads; a file is known by what it holds, not by its name."""
    with opened(path, most_bytes=MAX_FILE_BYTES, remedy=_COPY_AGAIN) as content:
        kind = kind_of(content.read(_SIGNATURE_BYTES), path.name)
    if kind == "video":
        raise video_as_photograph(path)
    return kind


def _read_foreign_header(path: Path, kind: str, min_side: int) -> ImageHeader:
    """The header of a photograph that OpenImageIO does not read; it is decoded upright."""
    if kind == "raw":
        raw = read_raw_header(path)
        _check_size(raw.width, raw.height, path, min_side)
        return ImageHeader(raw.width, raw.height, 1, bits=16, taken_with=raw.taken_with)
    heif = read_heif_header(path, kind)
    _check_size(heif.width, heif.height, path, min_side)
    return ImageHeader(heif.width, heif.height, 1, bits=heif.bits, taken_with=taken_with(heif.exif))


def read_pixels(
    path: Path, *, upright: bool = False, min_side: int = MIN_SIDE, development: Development | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Decode an image to display-referred sRGB.

    Integer images are taken as sRGB, or converted from what their ICC profile says, or where there is none, their EXIF
    data (Adobe RGB) or the number of their primaries (Display P3 of HEIF and AVIF); raw files are developed;
    floating-point ones (EXR, HDR, float TIFF) as linear with Rec. 709 primaries and encoded and clipped to [0, 1]. Grey
    becomes RGB. Colours are straight, not premultiplied.

    Args:
        path: the image file.
        upright: apply the EXIF orientation.
        min_side: smaller images are refused.
        development: of raw files; those of a capture have one in common. None: each its own.

    Returns:
        (H, W, 3) uint8 and (H, W) uint8 coverage, or None where there is no alpha channel or it is opaque everywhere,
        or the unused byte of BMP and Targa.

    Raises:
        InputError: as `read_header`, or the image is damaged or cut short.
    """
    kind = _kind(path)
    if kind:
        _read_foreign_header(path, kind, min_side)
        return (read_raw(path, development), None) if kind == "raw" else opaque_or(*read_heif(path, kind))
    with _opened(path) as file:
        spec = file.spec()
        _check_header(spec, path, min_side)
        linear, format_name = is_linear(spec), file.format_name()
        orientation = _orientation(spec, _further_exif(file, path)) if upright else 1
        pixels = file.read_image(oiio.FLOAT if linear else oiio.UINT8)
        # The JPEG and TIFF readers fill what is missing with grey or black, return it, and leave an error behind.
        error = readable(file.geterror, _UNREADABLE)
    if pixels is not None and error and format_name == "jpeg" and _is_whole_jpeg(path, error):
        error = ""
    if pixels is None or error:
        reason = error.splitlines()[0] if error else "no pixels could be read"
        raise InputError(f"the image is damaged or cut short ({reason})", where=path, remedy=_COPY_AGAIN)
    pixels = pixels.reshape(spec.height, spec.width, spec.nchannels)
    color, alpha = straight_srgb(pixels, spec, is_premultiplied(spec, format_name))
    if alpha is not None and is_filling(alpha, format_name):
        alpha = None
    if not linear and (profile := color_profile(spec, path)[1]):
        color = np.ascontiguousarray(color)
        convert_to_srgb(color, profile)
    color, alpha = opaque_or(color, alpha)
    color = apply_orientation(color, orientation)
    alpha = None if alpha is None else apply_orientation(alpha, orientation)
    return np.ascontiguousarray(color), alpha


def _is_whole_jpeg(path: Path, complaint: str) -> bool:
    """Whether a JPEG has all its pixels though libjpeg complains of it, as of the headers that Samsung's phones write.

    It says its first complaint alone, and a file with such a header may be cut short, too: Pillow notices that.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged EXIF data, which do not matter here
            with JpegImageFile(path) as picture:  # Image.open refuses 200 megapixels, which these phones take
                picture.load()
                is_progressive = "progressive" in picture.info
    except DAMAGE:
        return False
    # Tables stand between the scans of a progressive JPEG, too.
    return not (_LOST_PIXELS.search(complaint) or (is_progressive and "Corrupt JPEG data" in complaint))


@contextmanager
def _opened(path: Path) -> Iterator[oiio.ImageInput]:
    with opened(path, most_bytes=MAX_FILE_BYTES, remedy=_COPY_AGAIN) as content:
        _require_known_format(content.read(_SIGNATURE_BYTES), path)
    config = oiio.ImageSpec()
    # Otherwise PNG, TIFF and WebP colours come premultiplied and rounded to 8 bit.
    config.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), config)
    if file is None:
        reason = (readable(oiio.geterror, _UNREADABLE) or "unknown format").splitlines()[0]
        raise InputError(f"the image cannot be opened ({reason})", where=path, remedy=_COPY_AGAIN)
    try:
        yield file
    finally:
        file.close()


def _require_known_format(start: bytes, path: Path) -> None:
    """Refuse a file whose first bytes belong to none of the formats that `IMAGE_EXTENSIONS` stand for.

    OpenImageIO would try all that it knows, and each is a way in for a crafted file.
    """
    is_known = start.startswith(_SIGNATURES) or (start[:4] == b"RIFF" and start[8:12] == b"WEBP")
    # Targa files have nothing to be known by.
    if not is_known and path.suffix.lower() != ".tga":
        raise InputError("the image cannot be opened (unknown format)", where=path, remedy=_EXPORT_PLAIN)
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        raise InputError("the file's name is not UTF-8", where=path, remedy="rename it") from None


def _check_header(spec: oiio.ImageSpec, path: Path, min_side: int) -> None:
    width, height, channels = spec.width, spec.height, spec.nchannels
    _check_size(width, height, path, min_side)
    size = f"the image is {width} x {height} pixels"
    decoded = width * height * channels * (4 if is_linear(spec) else 1)
    spaces = [attribute(spec, name) for name in ("jpeg:ColorSpace", "tiff:ColorSpace", "oiio:ColorSpace")]
    what = remedy = ""
    if decoded > MAX_DECODED_BYTES:
        limit = f"{decoded / 1e6:,.0f} MB when decoded; the limit is {MAX_DECODED_BYTES / 1e6:,.0f}"
        what = f"{size} with {channels} channels, {limit}"
        remedy = "export it smaller or without the extra channels"
    elif spec.depth > 1 or channels < 1:
        what, remedy = "the image is a volume or has no channels", _EXPORT_PLAIN
    elif any(space.upper() in ("CMYK", "YCCK", "YCBCRK", "SEPARATED", "COLOR SEPARATED") for space in spaces):
        what, remedy = "the image is CMYK, made for print", _CONVERT
    elif any(space.upper() in ("CIELAB", "ICCLAB", "ITULAB") for space in spaces):
        what, remedy = "the image is Lab", _CONVERT
    if what:
        raise InputError(what, where=path, remedy=remedy)


def _check_size(width: int, height: int, path: Path, min_side: int) -> None:
    size = f"the image is {width} x {height} pixels"
    what = remedy = ""
    if max(width, height) > MAX_SIDE or width * height > MAX_MEGAPIXELS * 1_000_000:
        what = f"{size}, the limit is {MAX_SIDE} a side and {MAX_MEGAPIXELS} megapixels"
        remedy = "export it smaller"
    elif min(width, height) < min_side:
        what = f"{size}, too small to train on (at least {min_side} a side)"
        remedy = "export it larger or remove it from the capture"
    if what:
        raise InputError(what, where=path, remedy=remedy)


def _further_exif(file: oiio.ImageInput, path: Path) -> bytes:
    """Raw EXIF data where OpenImageIO does not read them itself."""
    return exif_of_webp(path) if file.format_name() == "webp" else b""


def _orientation(spec: oiio.ImageSpec, exif: bytes) -> int:
    orientation = orientation_of(exif) if exif else spec.get_int_attribute("Orientation", 1)
    return orientation if orientation in _ORIENTATION_STEPS else 1


def _has_pages(file: oiio.ImageInput, width: int, height: int) -> bool:
    """Whether a TIFF has several pages, or a WebP frames; reduced copies and thumbnails have other sizes."""
    if file.format_name() not in ("tiff", "webp") or not file.seek_subimage(1, 0):
        return False
    second = file.spec()
    return (second.width, second.height) == (width, height)


def _taken_with(spec: oiio.ImageSpec) -> str:
    numbers = (spec.get_float_attribute(name, 0.0) for name in LENS_ATTRIBUTES)
    return name_lens(attribute(spec, "Make"), attribute(spec, "Model"), *numbers)


def upright_rotation(orientation: int) -> NDArray[np.float64] | None:
    """(2, 2) map of directions in the stored image to those in the upright one; None for one that mirrors."""
    flip_rows, flip_columns, transpose = _ORIENTATION_STEPS[orientation]
    steps = np.diag([-1.0 if flip_columns else 1.0, -1.0 if flip_rows else 1.0])
    steps = steps[::-1] if transpose else steps
    return steps if np.linalg.det(steps) > 0.0 else None


def apply_orientation(pixels: NDArray[_Pixel], orientation: int) -> NDArray[_Pixel]:
    """Turn (H, W, ...) upright. (OpenImageIO's reorient exchanges orientations 5 and 7.)"""
    flip_rows, flip_columns, transpose = _ORIENTATION_STEPS[orientation]
    if flip_rows:
        pixels = pixels[::-1]
    if flip_columns:
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(pixels.swapaxes(0, 1) if transpose else pixels)
