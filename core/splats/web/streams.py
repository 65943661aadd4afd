"""Gaussians as the web page holds them: the geometry once, the colours of each layer. numpy only.

Positions are float32 about the scene's centre; a unit quaternion is four signed 16-bit numbers, the logarithms of the
scales and the opacity four unsigned ones; colours are half floats, and the terms that depend on the direction bytes.
That is 28 bytes a Gaussian and 6 for a layer of degree 0. The most important Gaussians come first, so that a part of
them is the scene with fewer. Columns and bytes of one kind lie together, which gzip likes.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..gaussians import SH_C0, Gaussians

_MOST_SIGNED, _MOST_UNSIGNED, _MOST_BYTE = 32767, 65535, 255
_LOG_SCALE_RANGE = (-40.0, 40.0)  # whose exponential the page's float32 holds
_LARGEST_HALF = 65504.0
_USUAL_TERM = 1.0  # of the terms that depend on the direction; SPZ files hold none beyond it
_NOT_CLIPPED = 0.999  # of all terms, where some are larger
_SAMPLED = 100_000  # Gaussians that tell how large terms are
_COMPRESSION = 6  # gzip's level; 9 takes three times as long for a hundredth of the size


@dataclass(frozen=True)
class Streams:
    """What the page's script reads.

    Attributes:
        description: of `data`, for JSON.
        data: compressed, base64, by name: ``means``, ``shapes`` and ``colors0``, ``rest0`` for the first layer, ...
    """

    description: dict[str, Any]
    data: dict[str, str]


def pack(layers: Mapping[str, Gaussians], origin: NDArray[np.float64]) -> Streams:
    """The Gaussians of `layers`, whose geometry is the first one's, with positions from `origin`."""
    first = next(iter(layers.values()))
    order = np.argsort(-first.importance, kind="stable")
    log_scales = np.clip(first.log_scales[order], *_LOG_SCALE_RANGE)
    low, high = float(log_scales.min()), float(log_scales.max())
    step = (high - low) / _MOST_UNSIGNED
    shapes = np.empty((len(first), 8), np.uint16)
    shapes[:, :4] = _signed(first.quaternions[order])
    shapes[:, 4:7] = np.round((log_scales - low) / (step or 1.0))
    shapes[:, 7] = np.round(first.opacities[order] * _MOST_UNSIGNED)
    means = (first.means[order].astype(np.float64) - origin).astype(np.float32)
    data = {"means": encode(means), "shapes": encode(shapes)}
    described = []
    for number, (name, gaussians) in enumerate(layers.items()):
        constant = np.clip(0.5 + SH_C0 * gaussians.sh[order, 0], -_LARGEST_HALF, _LARGEST_HALF)
        data[f"colors{number}"] = encode(constant.astype(np.float16))
        entry: dict[str, Any] = {"name": name, "degree": gaussians.sh_degree, "restCode": [0.0, 0.0]}
        if gaussians.sh_degree:
            codes, entry["restCode"] = _bytes(gaussians.sh[order, 1:].reshape(len(order), -1))
            data[f"rest{number}"] = encode(codes)
        described.append(entry)
    return Streams({"count": len(first), "scaleCode": [low, step], "layers": described}, data)


def encode(values: NDArray) -> str:
    """(N, width) numbers, column by column and byte by byte, compressed, as base64."""
    little = np.ascontiguousarray(values.T).astype(values.dtype.newbyteorder("<"), copy=False)
    planes = little.view(np.uint8).reshape(values.shape[1], values.shape[0], values.itemsize).transpose(0, 2, 1)
    return base64.b64encode(gzip.compress(planes.tobytes(), _COMPRESSION, mtime=0)).decode("ascii")


def _signed(quaternions: NDArray[np.float32]) -> NDArray[np.uint16]:
    """(N, 4) unit quaternions as the bits of signed numbers."""
    lengths = np.linalg.norm(quaternions.astype(np.float64), axis=1, keepdims=True)
    return np.round(quaternions / np.maximum(lengths, 1e-30) * _MOST_SIGNED).astype(np.int16).view(np.uint16)


def _bytes(terms: NDArray[np.float32]) -> tuple[NDArray[np.uint8], list[float]]:
    """Codes of (N, width) terms, and the value of code 0 and of a step; a few that are far too large are clipped."""
    largest = float(np.abs(terms).max())
    if largest > _USUAL_TERM:
        # A single one would leave next to no steps to all others.
        sizes = np.abs(terms[:: max(len(terms) // _SAMPLED, 1)])
        largest = max(float(np.quantile(sizes, _NOT_CLIPPED, method="lower")), _USUAL_TERM)
    step = 2.0 * largest / (_MOST_BYTE - 1) or 1.0  # so that zero has a code
    return np.round((np.clip(terms, -largest, largest) + largest) / step).astype(np.uint8), [-largest, step]
