"""HEIC, HEIF and AVIF photographs: upright, in sRGB. Depth maps and gain maps in them are left alone."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from ..color.profiles import DISPLAY_P3, convert_to_srgb
from ..errors import InputError

_COPY_AGAIN = "copy or export the image again"
_GAIN_MAP = ("gainmap", "iso:ts:21496")
_P3_PRIMARIES = 12  # ITU-T H.273
# Whatever goes wrong in a decoder that is given a damaged file.
_DAMAGE: tuple[type[Exception], ...] = (
    *(OSError, ValueError, SyntaxError, RuntimeError, EOFError, IndexError, KeyError, TypeError),
    ZeroDivisionError,
    Image.DecompressionBombError,
)


@dataclass(frozen=True)
class HeifHeader:
    """What such a file says of itself.

    Attributes:
        width, height: upright.
        bits: of a channel.
        exif: the raw EXIF data, or nothing.
        gain_map: whether there is one.
    """

    width: int
    height: int
    bits: int
    exif: bytes
    gain_map: bool


def read_heif_header(path: Path, kind: str) -> HeifHeader:
    """Size and EXIF data without the pixels; `kind` is "heif" or "avif".

    Raises:
        InputError: it is damaged, or a package is missing.
    """
    try:
        return _header(_open(path, kind), kind)
    except _DAMAGE as error:
        raise _damaged(path, error) from None


def read_heif(path: Path, kind: str) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """(H, W, 3) sRGB and (H, W) coverage or None; the caller has looked at the size.

    Raises:
        InputError: it is damaged, or a package is missing.
    """
    try:
        opened = _open(path, kind)
        picture = opened.to_pillow() if kind == "heif" else ImageOps.exif_transpose(opened)
        profile, nclx = opened.info.get("icc_profile"), opened.info.get("nclx_profile")
        coverage = np.array(picture.getchannel("A")) if picture.mode in ("RGBA", "LA") else None
        color = np.array(picture.convert("RGB"))
    except _DAMAGE as error:
        raise _damaged(path, error) from None
    if profile:
        convert_to_srgb(color, bytes(profile))
    elif isinstance(nclx, dict) and nclx.get("color_primaries") == _P3_PRIMARIES:
        convert_to_srgb(color, DISPLAY_P3)
    return color, coverage


def _open(path: Path, kind: str) -> Any:
    if kind == "avif":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the caller looks at the size
            return Image.open(path, formats=["AVIF"])
    try:
        import pillow_heif
    except ImportError:
        remedy = "install pillow-heif (run.py --doctor says how), or export JPEG"
        raise InputError("HEIC photographs need the package pillow-heif", where=path, remedy=remedy) from None
    return pillow_heif.open_heif(path)


def _header(opened: Any, kind: str) -> HeifHeader:
    width, height = opened.size
    exif = bytes(opened.info.get("exif") or b"")
    if kind == "avif" and opened.getexif().get(0x0112, 1) >= 5:  # Pillow makes an orientation of irot and imir
        width, height = height, width
    auxiliary = [str(name).lower() for name in opened.info.get("aux", {})]
    gain_map = any(word in name for name in auxiliary for word in _GAIN_MAP)
    return HeifHeader(width, height, int(opened.info.get("bit_depth", 8)), exif, gain_map)


def _damaged(path: Path, error: BaseException) -> InputError:
    if isinstance(error, InputError):
        return error
    return InputError("the image is damaged or cut short", where=path, remedy=_COPY_AGAIN)


def taken_with(exif: bytes) -> str:
    """Camera and focal length as `ImageHeader.taken_with` has them."""
    try:
        tags = Image.Exif()
        tags.load(exif)
        focal = tags.get_ifd(0x8769).get(0x920A)
        parts = [str(tags.get(0x010F, "")), str(tags.get(0x0110, "")), f"{float(focal):g} mm" if focal else ""]
    except _DAMAGE:  # a division by zero among them: lenses state 0/0 mm
        return ""
    return " ".join(part.strip("\0 ") for part in parts if part.strip("\0 "))
