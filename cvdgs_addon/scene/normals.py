"""Which way the surface faces at each Gaussian, guessed from the Gaussians around it.

The Gaussians about a place are a mixture, whose covariance is the mean of theirs plus that of their centres. Surfaces
are thin, so that the axis of its least variance is the normal. One Gaussian alone is a poor witness: those of a weave
are specks and threads. Sums over the neighbourhood are kept on a lattice, spread to and read from the eight corners
around each centre by trilinear weights, so that time and memory grow with the number of Gaussians alone.
"""

from __future__ import annotations

from itertools import product

import bpy
import numpy as np
from numpy.typing import NDArray

from .shapes import covariances, frame_map, towards_cameras
from .splat_attributes import Attribute, is_gaussian, point_positions, read_attribute, write_attribute

# Side of the lattice's cells in the mean distance of neighbours: half of it leaves specks of a weave in the normals,
# twice as much flattens the folds of a curtain (looked at in the demo's scene).
_CELL = 2.0
_NEIGHBOURS = 8  # which nearest neighbour's distance counts as that of neighbours
_SAMPLE = 1000  # Gaussians whose neighbours are looked for
# A Gaussian larger than so many cells counts as one of that size: a wall behind everything is no more than others.
_MOST_CELLS = 3.0
_FARTHEST = 1e6  # cells from the middle; keys of cells are to fit into 64 bits
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # entries of a symmetric matrix
_CORNERS = tuple(product((0, 1), repeat=3))


def store_normals(splats: bpy.types.Object) -> None:
    """Write `Attribute.NORMAL`: unit vectors in the axes in which the Gaussians were made, towards the cameras."""
    mesh = splats.data
    mask, back = is_gaussian(mesh), np.linalg.pinv(frame_map(mesh))
    found = surface_normals(
        point_positions(mesh) @ back.T, covariances(mesh), read_attribute(mesh, Attribute.OPACITY)[mask]
    )
    found *= np.where(((towards_cameras(splats) @ back.T) * found).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    normals = np.zeros((len(mesh.vertices), 3), np.float32)
    normals[mask] = found
    write_attribute(mesh, Attribute.NORMAL, "FLOAT_VECTOR", normals)
    mesh.update()


def surface_normals(positions: NDArray, shapes: NDArray[np.float64], opacities: NDArray) -> NDArray[np.float64]:
    """(N, 3) unit vectors, of either sign.

    Args:
        positions: (N, 3) centres.
        shapes: (N, 3, 3) covariances.
        opacities: (N,).
    """
    positions = positions - np.median(positions, axis=0)
    cell = _CELL * _spacing(positions)
    size = np.trace(shapes, axis1=1, axis2=2)
    shapes = shapes * np.minimum(1.0, (_MOST_CELLS * cell) ** 2 / np.maximum(size, 1e-30))[:, None, None]
    second = shapes + positions[:, :, None] * positions[:, None, :]
    moments = np.column_stack([np.ones(len(positions)), positions, *(second[:, row, column] for row, column in _UPPER)])
    sums = _around(positions / cell, moments * np.maximum(opacities, 1e-6)[:, None])
    sums = sums / sums[:, :1]
    mixture = np.empty((len(positions), 3, 3))
    for number, (row, column) in enumerate(_UPPER):
        variance = sums[:, 4 + number] - sums[:, 1 + row] * sums[:, 1 + column]
        mixture[:, row, column] = mixture[:, column, row] = variance
    return np.asarray(np.linalg.eigh(mixture)[1][:, :, 0])  # eigenvalues ascend


def _spacing(positions: NDArray[np.float64]) -> float:
    """Median distance of a Gaussian's neighbours."""
    step = max(len(positions) // _SAMPLE, 1)
    neighbours = min(_NEIGHBOURS, len(positions) - 1)
    distances = [
        np.partition(((positions - place) ** 2).sum(axis=1), neighbours)[neighbours] for place in positions[::step]
    ]
    return float(max(np.sqrt(np.median(distances)), 1e-12))


def _around(places: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, K) sums of (N, K) `values` over what is near each of (N, 3) `places`, in cells of the lattice."""
    places = np.clip(places, -_FARTHEST, _FARTHEST)
    cells = np.floor(places).astype(np.int64)
    inside = places - cells
    cells -= cells.min(axis=0)
    sides = cells.max(axis=0) + 2
    keys, weights = [], []
    for corner in _CORNERS:
        x, y, z = (cells + corner).T
        keys.append((x * sides[1] + y) * sides[2] + z)
        weights.append(np.where(corner, inside, 1.0 - inside).prod(axis=1))
    corners, which = np.unique(np.concatenate(keys), return_inverse=True)
    which = which.reshape(len(_CORNERS), -1)
    lattice = np.empty((len(corners), values.shape[1]))
    for column, value in enumerate(values.T):
        spread = np.concatenate([weight * value for weight in weights])
        lattice[:, column] = np.bincount(which.ravel(), weights=spread, minlength=len(corners))
    return sum((weight[:, None] * lattice[at] for weight, at in zip(weights, which, strict=True)), np.zeros(1))
