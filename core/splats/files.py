"""Gaussians in and out of files, whatever the format. numpy only: Blender's Python imports this.

What a file is decides its content when it is read, and its ending when it is written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..untrusted import opened
from .gaussians import MOST_FILE_BYTES, Gaussians
from .ply import EXPORT_PLAIN, read_ply, write_ply
from .splat_file import read_splat, write_splat
from .spz import GZIP_MAGIC, MAGIC, read_spz, write_spz

_WRITERS: dict[str, Callable[[Path, Gaussians], None]] = {".ply": write_ply, ".spz": write_spz, ".splat": write_splat}
SUFFIXES = tuple(_WRITERS)
# What splat programs write besides, by the ending; most have no first bytes to be known by.
_OTHER_FORMATS = {
    ".sog": "SOG (PlayCanvas, SuperSplat)",
    ".ksplat": "KSPLAT (GaussianSplats3D)",
    ".lcc": "LCC (XGRIDS)",
    ".spx": "SPX (Reall3D)",
    ".rad": "RAD (Spark)",
    ".glb": "glTF",
    ".gltf": "glTF",
}
_GLTF_MAGIC = b"glTF"
_HIGHEST_LOGIT = 30.0  # exporters write an opacity of one as an infinite logit; from 17 on float32 sees no difference


def read_gaussians(path: str | Path, *, drop_damaged: bool = False) -> Gaussians:
    """Read a 3DGS .ply (text or binary), a .spz (version 2 to 4) or a .splat file.

    Infinite opacity logits become large ones, and a rotation of length zero becomes none. All values of what is
    returned are finite.

    Args:
        path: the file.
        drop_damaged: leave Gaussians out that have other values that are no finite numbers, instead of refusing them.

    Raises:
        InputError: none of these formats, empty, cut short, a mesh, or damaged.
    """
    path = Path(path)
    gaussians = _reader(path)(path)
    if not len(gaussians):
        raise InputError("it holds no Gaussians", where=path, remedy="export it again")
    np.clip(gaussians.opacity_logits, -_HIGHEST_LOGIT, _HIGHEST_LOGIT, out=gaussians.opacity_logits)
    gaussians.quaternions[~gaussians.quaternions.any(axis=1), 0] = 1.0  # of length zero it has no direction to turn to
    damaged = _damaged(gaussians)
    if not damaged.any():
        return gaussians
    if not drop_damaged:
        raise InputError(
            f"{damaged.sum():,} of {len(gaussians):,} Gaussians have values that are no finite numbers",
            where=path,
            remedy="export it again, or leave them out (scripts/convert.py --drop-damaged)",
        )
    return gaussians.take(~damaged)


def write_gaussians(path: str | Path, gaussians: Gaussians) -> None:
    """Write `gaussians` in the format that the ending of `path` names: .ply, .spz (version 3) or .splat.

    A .splat file holds colours of degree 0 only. The file is complete or not there.

    Raises:
        InputError: an unknown ending, or the file cannot be written.
    """
    path = Path(path)
    require_known_suffix(path)
    _WRITERS[path.suffix.lower()](path, gaussians)


def require_known_suffix(path: Path) -> None:
    """Raise `InputError` unless `write_gaussians` knows what to write to `path`."""
    if path.suffix.lower() not in _WRITERS:
        raise InputError(
            f"'{path.suffix}' is no format for Gaussians", where=path, remedy=f"name the file {', '.join(SUFFIXES)}"
        )


def _reader(path: Path) -> Callable[[Path], Gaussians]:
    with opened(path, most_bytes=MOST_FILE_BYTES) as file:
        start = file.read(4)
    if not start:
        raise InputError("the file is empty", where=path, remedy="copy or export it again")
    if start[:3] == b"ply":
        return read_ply
    if start == MAGIC or start[:2] == GZIP_MAGIC:
        return read_spz
    # A .splat file has nothing to be known by but its ending.
    if path.suffix.lower() == ".splat":
        return read_splat
    suffix = ".glb" if start == _GLTF_MAGIC else path.suffix.lower()
    if suffix in _OTHER_FORMATS:
        raise InputError(f"{_OTHER_FORMATS[suffix]} is not read here", where=path, remedy=EXPORT_PLAIN)
    raise InputError(
        "not a file of Gaussians that is known here",
        where=path,
        remedy=f"choose one of {', '.join(SUFFIXES)}, or {EXPORT_PLAIN}",
    )


def _damaged(gaussians: Gaussians) -> NDArray[np.bool_]:
    """(N,) whether a value of the Gaussian is no finite number."""
    result = np.zeros(len(gaussians), bool)
    for field in fields(Gaussians):
        values = getattr(gaussians, field.name).reshape(len(gaussians), -1)
        with np.errstate(over="ignore", invalid="ignore"):
            # One pass over the sum in place of one a value; it overflows only where values are far beyond any use.
            result |= ~np.isfinite(values.sum(axis=1, dtype=np.float32))
    return result
