"""Decoded pixels of any channels as straight 8-bit sRGB and coverage."""

from __future__ import annotations

from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from .specs import is_linear, readable

_BAND_PIXELS = 1 << 20  # that are turned into sRGB at a time
# The one that OpenImageIO brings: a studio's own, which the variable OCIO names, need not know these spaces.
_COLOR_CONFIGURATION = "ocio://default"
_LINEAR = "lin_rec709"


def straight_srgb(
    pixels: NDArray[Any], spec: oiio.ImageSpec, premultiplied: bool
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """(H, W, C) pixels as `spec` describes them, float32 of linear light where `is_linear`, uint8 otherwise.

    Args:
        premultiplied: the colours are multiplied by alpha, where there is alpha; those of uint8 as they are encoded.

    Returns:
        (H, W, 3) straight colours and (H, W) alpha, or None where there is no such channel. Where alpha is 0, colours
        are what the file holds.
    """
    if is_linear(spec):
        return _encode_linear(pixels, spec, premultiplied)
    color, alpha = _split_channels(pixels, spec)
    if premultiplied and alpha is not None:
        _divide(color, alpha)
    return color, alpha


def _divide(color: NDArray[np.uint8], alpha: NDArray[np.uint8]) -> None:
    """Make premultiplied (H, W, 3) colours straight, in place."""
    rows = max(1, _BAND_PIXELS // color.shape[1])
    for top in range(0, len(color), rows):
        band = np.s_[top : top + rows]
        opacity = np.where(alpha[band] > 0, alpha[band], 255).astype(np.float32)[..., None]
        color[band] = np.rint(np.minimum(color[band] * (255.0 / opacity), 255.0)).astype(np.uint8)


def opaque_or(
    color: NDArray[np.uint8], alpha: NDArray[np.uint8] | None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """The same, without coverage that is full everywhere."""
    return color, None if alpha is None or alpha.min() == 255 else alpha


def _split_channels(pixels: NDArray, spec: oiio.ImageSpec) -> tuple[NDArray, NDArray | None]:
    """(H, W, 3) colour and (H, W) alpha or None; of an EXR with further channels, those named R, G, B and A."""
    unnamed: tuple[str, ...] = ()
    names = [name.upper() for name in readable(lambda: spec.channelnames, unnamed)]
    alpha_index = spec.alpha_channel
    if all(name in names for name in "RGB"):
        indices = [names.index(name) for name in "RGB"]
    else:
        others = [i for i in range(spec.nchannels) if i != alpha_index]
        indices = others[:3] if len(others) >= 3 else others[:1] * 3
    alpha = pixels[..., alpha_index] if 0 <= alpha_index < spec.nchannels and spec.nchannels > 1 else None
    if indices == [0, 1, 2] and spec.nchannels == 3:
        return pixels, alpha
    return np.ascontiguousarray(pixels[..., indices]), None if alpha is None else np.ascontiguousarray(alpha)


def _encode_linear(
    pixels: NDArray[np.float32], spec: oiio.ImageSpec, premultiplied: bool
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """(H, W, C) linear pixels to straight 8-bit sRGB and coverage, in bands, since each step makes a copy."""
    rows = max(1, _BAND_PIXELS // spec.width)
    parts = (_split_channels(pixels[top : top + rows], spec) for top in range(0, spec.height, rows))
    bands = [_encode_band(color, alpha, premultiplied) for color, alpha in parts]
    color = np.concatenate([color for color, _ in bands])
    coverage = [alpha for _, alpha in bands if alpha is not None]
    return color, np.concatenate(coverage) if coverage else None


def _encode_band(
    color: NDArray[np.float32], alpha: NDArray[np.float32] | None, premultiplied: bool
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Linear to straight 8-bit sRGB."""
    color = np.nan_to_num(color, nan=0.0, posinf=1.0, neginf=0.0)
    coverage = None
    if alpha is not None:
        opacity = np.clip(np.nan_to_num(alpha, nan=0.0), 0.0, 1.0)
        if premultiplied:
            color = color / np.where(opacity > 0.0, opacity, 1.0)[..., None]
        coverage = np.rint(opacity * 255.0).astype(np.uint8)
    encoded = _to_srgb(np.clip(color, 0.0, 1.0, dtype=np.float32), _LINEAR)
    return np.rint(np.clip(encoded, 0.0, 1.0) * 255.0).astype(np.uint8), coverage


def _to_srgb(color: NDArray[Any], space: str) -> NDArray[Any]:
    """(H, W, 3) colours of one of OpenImageIO's spaces as sRGB, of the same type."""
    buffer = oiio.ImageBuf(np.ascontiguousarray(color))
    converted = oiio.ImageBufAlgo.colorconvert(buffer, space, "sRGB", colorconfig=_COLOR_CONFIGURATION)
    return np.asarray(converted.get_pixels(buffer.spec().format))
