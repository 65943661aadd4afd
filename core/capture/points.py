"""Sparse point clouds as PLY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from ..ply_table import VertexTable
from ..untrusted import opened

_POSITION = ("x", "y", "z")
_COLOR = ("red", "green", "blue")
_GREY = 128
_WITHOUT = "export the points again, or remove ply_file_path to start without"
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
        colors = np.full((table.count, 3), _GREY, np.uint8)
        has_colors = set(_COLOR) <= set(table.names)
        start = 0
        for block in table.blocks():
            end = start + len(block)
            positions[start:end] = as_float32(np.stack([block[axis] for axis in _POSITION], axis=1))
            if has_colors:
                is_fraction = table.declared_type(_COLOR[0]).kind == "f"
                colors[start:end] = _to_bytes(np.stack([block[channel] for channel in _COLOR], axis=1), is_fraction)
            start = end
    return positions, colors


def _to_bytes(colors: NDArray, is_fraction: bool) -> NDArray[np.uint8]:
    """(P, 3) colours of any type; floating-point ones are shares of full brightness."""
    scale = 255.0 if is_fraction else 1.0
    return np.rint(np.clip(np.nan_to_num(colors) * scale, 0.0, 255.0)).astype(np.uint8)


def write_point_cloud(path: Path, points: NDArray[np.float32], colors: NDArray[np.uint8]) -> None:
    """Write (P, 3) positions and (P, 3) sRGB colours as a binary PLY file."""
    vertices = np.empty(len(points), [*((axis, "<f4") for axis in _POSITION), *((c, "u1") for c in _COLOR)])
    for index, (axis, channel) in enumerate(zip(_POSITION, _COLOR, strict=True)):
        vertices[axis], vertices[channel] = points[:, index], colors[:, index]
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(path))
