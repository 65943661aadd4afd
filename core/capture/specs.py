"""What an image file that OpenImageIO reads says of its colours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ..color.profiles import ADOBE_RGB
from ..intake.exif import SRGB, UNCALIBRATED, is_file_of_adobe_rgb

_T = TypeVar("_T")

_FILLED_TO_32_BITS = ("bmp", "targa")
_TARGA_PREMULTIPLIED = 4  # Truevision TGA 2.0, field 24, "attributes type"


def readable(ask: Callable[[], _T], otherwise: _T) -> _T:
    """The answer of OpenImageIO, or `otherwise` where it quotes text of the file that is not UTF-8."""
    try:
        return ask()
    except UnicodeDecodeError:
        return otherwise


def attribute(spec: oiio.ImageSpec, name: str) -> str:
    """A text, or an empty string where there is none."""
    return readable(lambda: spec.get_string_attribute(name), "")


def is_linear(spec: oiio.ImageSpec) -> bool:
    """Whether pixels are of linear light, as floating-point ones are."""
    return spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)


def is_premultiplied(spec: oiio.ImageSpec, format_name: str) -> bool:
    """Whether colours come multiplied by alpha, of a file that was opened with the hint "oiio:UnassociatedAlpha".

    Those of OpenEXR always do, those of TIFF unless ExtraSamples says otherwise (TIFF 6.0, section 18), and those of
    Targa where an extension says so. PNG, WebP and BMP hold straight ones.
    """
    if format_name == "targa":
        return bool(spec.get_int_attribute("targa:alpha_type", 0) == _TARGA_PREMULTIPLIED)
    return format_name == "openexr" or (
        format_name == "tiff" and not spec.get_int_attribute("oiio:UnassociatedAlpha", 0)
    )


def is_filling(alpha: NDArray[np.uint8], format_name: str) -> bool:
    """Whether (H, W) alpha is but the fourth byte of 32 bits a pixel, which many writers of BMP and Targa leave 0."""
    return format_name in _FILLED_TO_32_BITS and not alpha.any()


def color_profile(spec: oiio.ImageSpec, path: Path) -> tuple[str, bytes]:
    """What describes the colours of pixels as they are stored: what it calls itself, and an ICC profile.

    That is the profile in the file, or one for what EXIF data say. Both are empty where there is none, and the profile
    alone where EXIF data say no more than that the colours are not sRGB.
    """
    profile = readable(lambda: spec.getattribute("ICCProfile"), None)
    if profile is not None and not isinstance(profile, str):
        return attribute(spec, "ICCProfile:profile_description"), bytes(profile)
    if is_linear(spec) or spec.get_int_attribute("Exif:ColorSpace", SRGB) != UNCALIBRATED:
        return "", b""
    if is_file_of_adobe_rgb(path):
        return "Adobe RGB (EXIF)", ADOBE_RGB
    return "uncalibrated (EXIF)", b""


def is_named_srgb(profile: str) -> bool:
    """Whether a profile that cannot be converted calls itself sRGB; of what can be, the name does not count."""
    name = profile.lower()
    # Of "Display P3 Gamut with sRGB Transfer" the transfer alone is, and of "Linear sRGB" the primaries.
    return "srgb" in name and not any(other in name for other in ("p3", "linear"))
