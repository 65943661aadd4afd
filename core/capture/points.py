"""Sparse point clouds as PLY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement, PlyParseError

from ..errors import InputError

_GREY = 128


def as_float32(positions: NDArray) -> NDArray[np.float32]:
    """Positions in single precision; those beyond its range become infinite, which readers leave out."""
    with np.errstate(over="ignore"):
        return positions.astype(np.float32)


def read_point_cloud(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """(P, 3) positions and (P, 3) sRGB colours, grey where the file has none.

    Raises:
        InputError: not a PLY file, cut, or without positions.
    """
    remedy = "export the points again, or remove ply_file_path to start without"
    try:
        vertices = PlyData.read(str(path))["vertex"].data
        positions = as_float32(np.stack([vertices[axis] for axis in "xyz"], axis=1))
    except (PlyParseError, KeyError, ValueError, TypeError, MemoryError, OSError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"the points cannot be read ({reason})", where=path, remedy=remedy) from None
    channels = ("red", "green", "blue")
    if not all(channel in (vertices.dtype.names or ()) for channel in channels):
        return positions, np.full(positions.shape, _GREY, np.uint8)
    colors = np.stack([vertices[channel] for channel in channels], axis=1)
    if colors.dtype.kind == "f":
        colors = np.rint(np.clip(np.nan_to_num(colors), 0.0, 1.0) * 255.0)
    return positions, np.clip(colors, 0, 255).astype(np.uint8)


def write_point_cloud(path: Path, points: NDArray[np.float32], colors: NDArray[np.uint8]) -> None:
    """Write (P, 3) positions and (P, 3) sRGB colours as a binary PLY file."""
    vertices = np.empty(
        len(points), [*((axis, "<f4") for axis in "xyz"), *((c, "u1") for c in ("red", "green", "blue"))]
    )
    for index, axis in enumerate("xyz"):
        vertices[axis] = points[:, index]
    for index, channel in enumerate(("red", "green", "blue")):
        vertices[channel] = colors[:, index]
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(path))
