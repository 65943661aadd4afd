"""ICC profiles: photographs of other colour spaces as sRGB, by Little CMS in Pillow."""

from __future__ import annotations

import io
import struct
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

MAX_PROFILE_BYTES = 4 << 20  # the largest, of printers, have 3 MB
_HEADER_BYTES = 128
_SPACE = slice(16, 20)  # ICC.1:2022, 7.2.6
_BAND_PIXELS = 1 << 20
_PROBE_STEPS = 17  # of each channel
# Tables of 1,024 steps, as in the most used profile of sRGB, are off by this much in a few colours of a thousand.
_ROUNDING = 1


def describe(profile: bytes) -> str:
    """What the profile calls itself, or an empty string."""
    try:
        return ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(profile))).strip()
    except (OSError, ValueError, TypeError, ImageCms.PyCMSError):
        return ""


def can_convert(profile: bytes) -> bool:
    """Whether `convert_to_srgb` understands the profile."""
    return _transform(profile) is not None


def convert_to_srgb(color: NDArray[np.uint8], profile: bytes) -> bool:
    """Make (H, W, 3) colours sRGB, in place; returns whether that could be done.

    Relative colorimetric: what both spaces hold keeps its colour, and what sRGB does not hold is clipped. Colours whose
    profile is sRGB's, whatever its name, stay exactly what they are.
    """
    transform = _transform(profile)
    if transform is None:
        return False
    if not _is_srgb(profile):
        _apply(transform, color)
    return True


def _apply(transform: Any, color: NDArray[np.uint8]) -> None:
    rows = max(1, _BAND_PIXELS // color.shape[1])
    for top in range(0, len(color), rows):
        band = Image.fromarray(np.ascontiguousarray(color[top : top + rows]))
        color[top : top + rows] = np.asarray(ImageCms.applyTransform(band, transform))


@lru_cache(maxsize=8)
def _is_srgb(profile: bytes) -> bool:
    """Whether a profile that can be converted leaves colours as they are: all greys, and a grid of colours."""
    levels = np.linspace(0, 255, _PROBE_STEPS).round().astype(np.uint8)
    grid = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(-1, 3)
    greys = np.arange(256, dtype=np.uint8)[:, None].repeat(3, axis=1)
    colors = np.concatenate([grid, greys])[None]
    converted = colors.copy()
    _apply(_transform(profile), converted)
    return int(np.abs(converted.astype(np.int16) - colors).max()) <= _ROUNDING


@lru_cache(maxsize=8)
def _transform(profile: bytes) -> Any:
    """None for profiles of other than red, green and blue, or that Little CMS refuses."""
    if not _HEADER_BYTES <= len(profile) <= MAX_PROFILE_BYTES or profile[_SPACE] != b"RGB ":
        return None
    try:
        return ImageCms.buildTransform(
            ImageCms.ImageCmsProfile(io.BytesIO(profile)),
            ImageCms.createProfile("sRGB"),
            "RGB",
            "RGB",
            ImageCms.Intent.RELATIVE_COLORIMETRIC,
            # Without the first flag, tables of 33 steps stand for the curves of profiles with matrices.
            ImageCms.Flags.HIGHRESPRECALC | ImageCms.Flags.BLACKPOINTCOMPENSATION,
        )
    except (OSError, ValueError, TypeError, ImageCms.PyCMSError):
        return None


def _matrix_profile(name: str, columns: tuple[tuple[float, float, float], ...], curve: bytes) -> bytes:
    """An ICC profile of version 2 (ICC.1:2001-04).

    Args:
        name: what it calls itself.
        columns: XYZ of red, green and blue, adapted to D50.
        curve: the tag of the curve of all three.
    """

    def tag(*values: float) -> bytes:
        return b"XYZ " + bytes(4) + b"".join(struct.pack(">i", round(value * 65536)) for value in values)

    called = name.encode() + b"\0"
    tags = {
        b"wtpt": tag(0.9642, 1.0, 0.8249),
        **{channel + b"XYZ": tag(*column) for channel, column in zip((b"r", b"g", b"b"), columns, strict=True)},
        b"rTRC": curve,
        b"gTRC": curve,
        b"bTRC": curve,
        b"cprt": b"text" + bytes(4) + b"none\0\0\0\0",
        b"desc": b"desc" + bytes(4) + struct.pack(">I", len(called)) + called + bytes(79),
    }
    table, data, at = b"", b"", 128 + 4 + 12 * len(tags)
    for key, content in tags.items():
        content += bytes(-len(content) % 4)
        table += key + struct.pack(">II", at + len(data), len(content))
        data += content
    head = struct.pack(">I", at + len(data)) + bytes(4) + b"\x02\x20\0\0" + b"mntrRGB XYZ " + bytes(12) + b"acsp"
    head += bytes(28) + struct.pack(">iii", 63190, 65536, 54061)
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + data


def _curve_of_srgb() -> bytes:
    """Type 3 of ICC.1:2022, 10.18: exponent, a, b, c, d."""
    values = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
    return b"para" + bytes(4) + struct.pack(">HH", 3, 0) + b"".join(struct.pack(">i", round(v * 65536)) for v in values)


_P3_COLUMNS = ((0.51512, 0.24119, -0.00105), (0.29198, 0.69225, 0.04189), (0.15710, 0.06657, 0.78407))
DISPLAY_P3 = _matrix_profile("Display P3", _P3_COLUMNS, _curve_of_srgb())
"""For what says by a number alone that it is: its primaries by Bradford, and sRGB's curve."""

_BT2020_COLUMNS = ((0.67348, 0.27904, -0.00193), (0.16567, 0.67534, 0.02998), (0.12505, 0.04561, 0.79685))
BT2020 = _matrix_profile("BT.2020", _BT2020_COLUMNS, _curve_of_srgb())
"""The same of what is not HDR, whose curve is taken as sRGB's, as that of BT.709 is."""

# Adobe RGB (1998) Color Image Encoding, version 2005-05: the primaries in the ICC's connection space, and the exponent.
_ADOBE_COLUMNS = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
_ADOBE_GAMMA = 2 + 51 / 256
ADOBE_RGB = _matrix_profile(
    "Adobe RGB (1998)",
    _ADOBE_COLUMNS,
    b"curv" + bytes(4) + struct.pack(">IH", 1, round(_ADOBE_GAMMA * 256)),
)
"""For what says by its EXIF data alone that it is."""
