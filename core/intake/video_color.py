"""A decoded frame as an upright sRGB picture.

Y'CbCr is turned into R'G'B' with the matrix that the frame names (ITU-T H.273; BT.709, BT.601, BT.2020).
Display-referred BT.709 is taken as sRGB, as every player does; HLG and PQ are tone-mapped (`color.hdr`), Display P3 and
BT.2020 are converted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ..color.hdr import REFERENCE_WHITE, TRANSFERS, to_light, tone_map
from ..color.profiles import BT2020, DISPLAY_P3, convert_to_srgb

# Weights of red and blue in luma, by H.273's number of the matrix.
_BT601, _BT709, _BT2020 = (0.299, 0.114), (0.2126, 0.0722), (0.2627, 0.0593)
_MATRICES = {1: _BT709, 5: _BT601, 6: _BT601, 9: _BT2020, 10: _BT2020}
_BT2020_MATRIX = 9
_UNKNOWN = (0, 2)  # transfer characteristics of which nothing is said
_HD_HEIGHT = 720  # from here on what says nothing is BT.709
_FULL_RANGE = 2
_PROFILES = {9: BT2020, 12: DISPLAY_P3}  # by H.273's number of the primaries
_SMALL_SIDE = 240  # pixels
_PLANAR = {"yuv420p": 8, "yuvj420p": 8, "yuv422p": 8, "yuvj422p": 8, "yuv444p": 8, "yuvj444p": 8} | {
    f"yuv{kind}p{bits}le": bits for kind in (420, 422, 444) for bits in (10, 12)
}


def square_size(width: int, height: int, aspect: float) -> tuple[int, int]:
    """(width, height) of a picture whose pixels, `aspect` times as wide as high, are made square.

    The side that has pixels to spare is made smaller; a single one stays, which is a converter's rounding.
    """
    square = (width, max(1, round(height / aspect))) if aspect > 1.0 else (max(1, round(width * aspect)), height)
    return (width, height) if width + height - sum(square) <= 1 else square


def frame_colors(frame: Any, white: float = REFERENCE_WHITE, aspect: float = 1.0) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB of a frame of PyAV, in square pixels and turned as its rotation says.

    Args:
        white: of HDR, see `color.hdr.white_of`.
        aspect: width of a pixel by its height.
    """
    transfer = transfer_of(frame)
    if frame.format.name in _PLANAR:
        encoded = _rgb(frame)
        color = tone_map(encoded, transfer, white) if transfer else encoded.clamp(0.0, 1.0)
        pixels = (color * 255.0).round().to(torch.uint8).permute(1, 2, 0).numpy()
    else:
        pixels = frame.to_ndarray(format="rgb24")
        if transfer:
            tensor = torch.from_numpy(pixels).permute(2, 0, 1).float() / 255.0
            pixels = (tone_map(tensor, transfer, white) * 255.0).round().to(torch.uint8).permute(1, 2, 0).numpy()
    pixels = np.ascontiguousarray(pixels)
    profile = _PROFILES.get(int(frame.color_primaries or 0))
    if profile and not (transfer or is_log(frame)):
        convert_to_srgb(pixels, profile)
    size = square_size(frame.width, frame.height, aspect)
    if size != (frame.width, frame.height):
        pixels = np.array(Image.fromarray(pixels).resize(size, Image.Resampling.BICUBIC))
    # FFmpeg's angle counts against the clock, as numpy does.
    return np.ascontiguousarray(np.rot90(pixels, round(frame.rotation / 90.0)))


def transfer_of(frame: Any) -> str:
    """ "hlg", "pq" or "" (not HDR), as the frame says."""
    return TRANSFERS.get(int(frame.color_trc or 0), "")


def is_log(frame: Any) -> bool:
    """Whether a frame is log, as it seems: of BT.2020, and of a curve for which H.273 has no number (Apple Log)."""
    return int(frame.colorspace or 0) == _BT2020_MATRIX and int(frame.color_trc or 0) in _UNKNOWN


def small_light(frame: Any) -> Tensor | None:
    """(3, h, w) cd/m² of some pixels of an HDR frame; None for others."""
    transfer = transfer_of(frame)
    if not transfer or frame.format.name not in _PLANAR:
        return None
    step = max(1, max(frame.width, frame.height) // _SMALL_SIDE)
    return to_light(_rgb(frame)[:, ::step, ::step], transfer)


def _rgb(frame: Any) -> Tensor:
    """(3, H, W) R'G'B' of a frame of planar Y'CbCr; not clipped."""
    bits = _PLANAR[frame.format.name]
    full = int(frame.color_range or 0) == _FULL_RANGE or frame.format.name.startswith("yuvj")
    luma, blue, red = (_plane(plane, bits) for plane in frame.planes[:3])
    unit = 2.0 ** (bits - 8)
    if full:
        luma, blue, red = luma / (2**bits - 1), (blue - 128 * unit) / (2**bits - 1), (red - 128 * unit) / (2**bits - 1)
    else:
        luma = (luma - 16 * unit) / (219 * unit)
        blue, red = (blue - 128 * unit) / (224 * unit), (red - 128 * unit) / (224 * unit)
    blue, red = (_upsampled(plane, luma.shape) for plane in (blue, red))
    default = _BT709 if min(frame.width, frame.height) >= _HD_HEIGHT else _BT601
    of_red, of_blue = _MATRICES.get(int(frame.colorspace or 0), default)
    r = luma + 2.0 * (1.0 - of_red) * red
    b = luma + 2.0 * (1.0 - of_blue) * blue
    g = (luma - of_red * r - of_blue * b) / (1.0 - of_red - of_blue)
    return torch.stack([r, g, b])


def _plane(plane: Any, bits: int) -> Tensor:
    kind = np.dtype("u1" if bits == 8 else "<u2")
    rows = np.frombuffer(plane, kind).reshape(plane.height, -1)[:, : plane.width]
    return torch.from_numpy(rows.astype(np.float32))


def _upsampled(plane: Tensor, shape: torch.Size) -> Tensor:
    """Colour differences at every pixel: between rows, and beside each second column, as H.264 and HEVC place them."""
    height, width = shape
    if plane.shape[0] != height:
        plane = F.interpolate(plane[None, None], size=(height, plane.shape[1]), mode="bilinear")[0, 0]
    if plane.shape[1] != width:
        following = torch.cat([plane[:, 1:], plane[:, -1:]], 1)
        plane = torch.stack([plane, (plane + following) / 2.0], 2).flatten(1)[:, :width]
    return plane
