"""The .splat files of web viewers, in and out. numpy only: Blender's Python imports this.

A file is a row of 32-byte records without a header (the layout of the viewer antimatter15/splat): position and standard
deviations as three little-endian float32 each, then a byte each for red, green, blue, opacity and the quaternion wxyz,
whose components c from -1 to 1 are stored as 128 c + 128. Colours do not depend on the direction. The conversions to
and from bytes also serve SPZ files.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...files.untrusted import opened, writing_whole
from ..gaussians import MOST_FILE_BYTES, SH_C0, Gaussians, require_room

_RECORD = np.dtype(
    [("mean", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 3), ("opacity", "u1"), ("quaternion", "u1", 4)]
)
_MOST_LOG_SCALE = 88.0  # exp of which float32 holds
_SMALLEST_SCALE = 1e-20  # scene units; flat Gaussians are stored with a scale of zero, whose logarithm is infinite
# The bytes 0 and 255 stand for the half steps at the ends; the middle of these has a finite logit.
_END = 0.25


def write_splat(path: str | Path, gaussians: Gaussians) -> None:
    """Write means and scales in full precision and the rest in bytes; colour terms above degree 0 are dropped."""
    records = np.empty(len(gaussians), _RECORD)
    records["mean"] = gaussians.means
    records["scale"] = finite_scales(gaussians.log_scales)
    records["color"] = to_bytes(gaussians.base_colors * 255.0)
    records["opacity"] = opacities_to_bytes(gaussians.opacity_logits)
    records["quaternion"] = to_bytes(normalised(gaussians.quaternions) * 128.0 + 128.0)
    with writing_whole(Path(path)) as file:
        file.write(records.data)


def read_splat(path: str | Path) -> Gaussians:
    """Read a .splat file.

    Raises:
        InputError: the file's length is not a multiple of a record's.
    """
    path = Path(path)
    with opened(path, most_bytes=MOST_FILE_BYTES) as file:
        size = os.fstat(file.fileno()).st_size
        if size % _RECORD.itemsize:
            raise InputError(
                f"its {size} bytes are not a multiple of {_RECORD.itemsize}, the size of a Gaussian",
                where=path,
                remedy="copy it again, or choose a .splat file",
            )
        require_room(size // _RECORD.itemsize, 0, path)
        records = np.fromfile(file, _RECORD)
    sh = ((records["color"] / np.float32(255.0) - 0.5) / SH_C0)[:, None]
    return Gaussians(
        means=np.ascontiguousarray(records["mean"]),
        log_scales=logarithm(records["scale"]),
        quaternions=(records["quaternion"].astype(np.float32) - 128.0) / 128.0,
        opacity_logits=bytes_to_opacity_logits(records["opacity"]),
        sh=sh.astype(np.float32),
    )


def finite_scales(log_scales: NDArray[np.float32]) -> NDArray[np.float64]:
    """The standard deviations, none of which is too large for float32."""
    return np.exp(np.minimum(log_scales, _MOST_LOG_SCALE).astype(np.float64))


def logarithm(scales: np.ndarray) -> np.ndarray:
    """Logarithms of `scales`; NaN for negative ones, which no writer produces."""
    with np.errstate(invalid="ignore"):
        return np.log(np.where(scales >= 0.0, np.maximum(scales, scales.dtype.type(_SMALLEST_SCALE)), scales))


def to_bytes(values: NDArray) -> NDArray[np.uint8]:
    """The nearest integers in 0..255, halves rounded up; NaN becomes 0."""
    return np.clip(np.floor(np.nan_to_num(values) + 0.5), 0.0, 255.0).astype(np.uint8)


def opacities_to_bytes(logits: NDArray[np.float32]) -> NDArray[np.uint8]:
    """sigmoid(logit) in 255ths."""
    with np.errstate(over="ignore"):  # exp(-logit) of a logit below -88 is infinite, and the opacity zero
        return to_bytes(255.0 / (1.0 + np.exp(-logits)))


def bytes_to_opacity_logits(opacities: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The logits, finite throughout."""
    steps = np.clip(opacities.astype(np.float32), _END, 255.0 - _END)
    return np.log(steps / (255.0 - steps))


def normalised(quaternions: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 4) of unit length; the identity (wxyz) where the length is zero."""
    largest = np.abs(quaternions).max(axis=1, keepdims=True)  # its square, unlike theirs, cannot overflow
    zero = (largest == 0.0)[:, 0]
    result = np.divide(quaternions, largest, out=np.zeros_like(quaternions), where=largest > 0.0)
    result[zero, 0] = 1.0
    return result / np.linalg.norm(result, axis=1, keepdims=True)
