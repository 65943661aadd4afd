"""Reads and writes files of Gaussians of any format. numpy only: Blender's Python imports this.

The format is recognised by the content when a file is read, and chosen by the suffix when it is written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...files.untrusted import opened
from ..gaussians import MOST_FILE_BYTES, Gaussians
from .ply import EXPORT_PLAIN, read_ply, write_ply
from .splat_file import read_splat, write_splat
from .spz import GZIP_MAGIC, MAGIC, read_spz, write_spz

_WRITERS: dict[str, Callable[[Path, Gaussians], None]] = {".ply": write_ply, ".spz": write_spz, ".splat": write_splat}
SUFFIXES = tuple(_WRITERS)
# Other formats of splat programs, by suffix; most have no magic bytes.
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
_HIGHEST_LOGIT = 30.0  # exporters write an opacity of one as an infinite logit; from 17 on, float32 opacities are one


def read_gaussians(path: str | Path, *, drop_damaged: bool = False) -> Gaussians:
    """Read a 3DGS .ply (text or binary), a .spz (version 2 to 4) or a .splat file.

    Infinite opacity logits become large ones, and rotations of length zero the identity. All returned values are
    finite.

    Args:
        path: the file.
        drop_damaged: drop Gaussians with other values that are not finite, instead of refusing the file.

    Raises:
        InputError: none of these formats, empty, cut short, a mesh, or damaged.
    """
    path = Path(path)
    gaussians = _reader(path)(path)
    if not len(gaussians):
        raise InputError("it holds no Gaussians", where=path, remedy="export it again")
    np.clip(gaussians.opacity_logits, -_HIGHEST_LOGIT, _HIGHEST_LOGIT, out=gaussians.opacity_logits)
    gaussians.quaternions[~gaussians.quaternions.any(axis=1), 0] = 1.0
    damaged = _damaged(gaussians)
    if not damaged.any():
        return gaussians
    if not drop_damaged:
        raise InputError(
            f"{damaged.sum():,} of {len(gaussians):,} Gaussians have values that are not finite numbers",
            where=path,
            remedy="export it again, or drop them (scripts/convert.py --drop-damaged)",
        )
    return gaussians.take(~damaged)


def write_gaussians(path: str | Path, gaussians: Gaussians) -> None:
    """Write `gaussians` in the format of the suffix of `path`: .ply, .spz (version 3) or .splat.

    A .splat file holds colours of degree 0 only. The file is written completely or not at all.

    Raises:
        InputError: an unknown suffix, or the file cannot be written.
    """
    path = Path(path)
    require_known_suffix(path)
    _WRITERS[path.suffix.lower()](path, gaussians)


def require_known_suffix(path: Path) -> None:
    """Raise `InputError` unless `write_gaussians` can write to a file with the suffix of `path`."""
    if path.suffix.lower() not in _WRITERS:
        raise InputError(
            f"'{path.suffix}' is not a format for Gaussians", where=path, remedy=f"name the file {', '.join(SUFFIXES)}"
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
    # A .splat file has no magic bytes: only its suffix tells.
    if path.suffix.lower() == ".splat":
        return read_splat
    suffix = ".glb" if start == _GLTF_MAGIC else path.suffix.lower()
    if suffix in _OTHER_FORMATS:
        raise InputError(f"{_OTHER_FORMATS[suffix]} cannot be read", where=path, remedy=EXPORT_PLAIN)
    raise InputError(
        "not a file of Gaussians in a known format",
        where=path,
        remedy=f"choose one of {', '.join(SUFFIXES)}, or {EXPORT_PLAIN}",
    )


def _damaged(gaussians: Gaussians) -> NDArray[np.bool_]:
    """(N,) whether any value of the Gaussian is not finite."""
    result = np.zeros(len(gaussians), bool)
    for field in fields(Gaussians):
        values = getattr(gaussians, field.name).reshape(len(gaussians), -1)
        with np.errstate(over="ignore", invalid="ignore"):
            # One pass over the sum instead of one per value; it overflows only for values far beyond any use.
            result |= ~np.isfinite(values.sum(axis=1, dtype=np.float32))
    return result
