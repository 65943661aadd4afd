"""The .splat files of web viewers, in and out. numpy only: Blender's Python imports this.

A file is a row of 32-byte records without a header (the layout of the viewer antimatter15/splat): position and standard
deviations as three little-endian float32 each, then a byte each for red, green, blue, opacity and the quaternion wxyz,
whose components from -1 to 1 are stored as 128 times themselves plus 128. Colours do not depend on the direction.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..untrusted import opened
from ..whole_file import writing_whole
from .gaussians import MOST_FILE_BYTES, SH_C0, Gaussians, require_room
from .quantised import bytes_to_opacity_logits, normalised, opacities_to_bytes, to_bytes

_RECORD = np.dtype(
    [("mean", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 3), ("opacity", "u1"), ("quaternion", "u1", 4)]
)
_SMALLEST_SCALE = 1e-20  # scene units; flat Gaussians are stored with a scale of zero, whose logarithm is infinite


def write_splat(path: str | Path, gaussians: Gaussians) -> None:
    """Write means and scales as they are and the rest in a byte each; colour terms above degree 0 are left out."""
    records = np.empty(len(gaussians), _RECORD)
    records["mean"] = gaussians.means
    records["scale"] = np.exp(gaussians.log_scales)
    records["color"] = to_bytes(gaussians.base_colors * 255.0)
    records["opacity"] = opacities_to_bytes(gaussians.opacity_logits)
    records["quaternion"] = to_bytes(normalised(gaussians.quaternions) * 128.0 + 128.0)
    with writing_whole(Path(path)) as file:
        file.write(records.data)


def read_splat(path: str | Path) -> Gaussians:
    """Read a .splat file.

    Raises:
        InputError: its length is no multiple of a record's.
    """
    path = Path(path)
    with opened(path, most_bytes=MOST_FILE_BYTES) as file:
        size = os.fstat(file.fileno()).st_size
        if size % _RECORD.itemsize:
            raise InputError(
                f"its {size} bytes are no multiple of {_RECORD.itemsize}, the length of a Gaussian",
                where=path,
                remedy="copy it again, or choose a .splat file",
            )
        require_room(size // _RECORD.itemsize, 0, path)
        records = np.fromfile(file, _RECORD)
    sh = ((records["color"] / np.float32(255.0) - 0.5) / SH_C0)[:, None]
    return Gaussians(
        means=np.ascontiguousarray(records["mean"]),
        log_scales=_logarithm(records["scale"]),
        quaternions=(records["quaternion"].astype(np.float32) - 128.0) / 128.0,
        opacity_logits=bytes_to_opacity_logits(records["opacity"]),
        sh=sh.astype(np.float32),
    )


def _logarithm(scales: np.ndarray) -> np.ndarray:
    """Of `scales`, with NaN for negative ones, which no writer makes."""
    with np.errstate(invalid="ignore"):
        return np.log(np.where(scales >= 0.0, np.maximum(scales, np.float32(_SMALLEST_SCALE)), scales))
