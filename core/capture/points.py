"""Sparse point clouds as PLY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from ..files.ply import VertexTable
from ..files.untrusted import opened

_POSITION = ("x", "y", "z")
_COLOR = ("red", "green", "blue")
_GREY = 128
_WITHOUT = "export the points again, or remove ply_file_path to start without points"
_MOST_BYTES = 1 << 30  # of a file; 70 million points with colours, of which a reconstruction uses few


def as_float32(positions: NDArray) -> NDArray[np.float32]:
    """Positions in single precision; those beyond its range become infinite, which readers leave out."""
    with np.errstate(over="ignore"):
        return positions.astype(np.float32)


def read_point_cloud(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """(P, 3) positions and (P, 3) sRGB colours, grey where the file has none.

    Raises:
        InputError: not a PLY file, cut, or without positions.
    """
    with opened(path, most_bytes=_MOST_BYTES, remedy=_WITHOUT) as file:
        table = VertexTable(file, path, noun="points", remedy=_WITHOUT)
        table.require(_POSITION, "the points have no positions")
        positions = np.empty((table.count, 3), np.float32)
        has_colors = set(_COLOR) <= set(table.names)
        kind = table.declared_type(_COLOR[0]) if has_colors else np.dtype(np.uint8)
        colors = np.full((table.count, 3), _GREY, np.uint16 if kind == np.uint16 else np.uint8)
        start = 0
        for block in table.blocks():
            end = start + len(block)
            positions[start:end] = as_float32(np.stack([block[axis] for axis in _POSITION], axis=1))
            if has_colors:
                channels = np.stack([block[channel] for channel in _COLOR], axis=1)
                colors[start:end] = _to_integers(channels * 255.0 if kind.kind == "f" else channels, colors.dtype)
            start = end
    return positions, _to_8_bits(colors)


def _to_integers(values: NDArray, dtype: np.dtype) -> NDArray:
    """Values of any type, rounded and clipped to the range of an unsigned integer `dtype`; 0 where they are NaN."""
    return np.rint(np.clip(np.nan_to_num(values), 0, np.iinfo(dtype).max)).astype(dtype)


def _to_8_bits(colors: NDArray) -> NDArray[np.uint8]:
    """Colours of 8 bits from those in fields of 8 or 16 bits; the wide fields of some programs hold 8 bits too."""
    if colors.max(initial=0) > 255:
        colors = colors >> 8
    return colors.astype(np.uint8, copy=False)


def write_point_cloud(path: Path, points: NDArray[np.float32], colors: NDArray[np.uint8]) -> None:
    """Write (P, 3) positions and (P, 3) sRGB colours as a binary PLY file."""
    vertices = np.empty(len(points), [*((axis, "<f4") for axis in _POSITION), *((c, "u1") for c in _COLOR)])
    for index, (axis, channel) in enumerate(zip(_POSITION, _COLOR, strict=True)):
        vertices[axis], vertices[channel] = points[:, index], colors[:, index]
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(path))
