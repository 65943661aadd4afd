"""Points of depth maps: those on which several views agree, thinned to about as many as are wanted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .depth_maps import DepthMaps

_BISECTIONS = 18
_COARSEST = 12.0  # log2 of a cube's side in footprints
_FULL = 0.97  # share of the wanted number that is enough
_CUBE_MASK = (1 << 21) - 1


@dataclass(frozen=True)
class DensePoints:
    """Points on surfaces.

    Attributes:
        positions: (N, 3) in the frame of the views' poses.
        colors: (N, 3) in [0, 1].
        footprints: (N,) size of the pixel that each comes from, at its depth.
    """

    positions: NDArray[np.float32]
    colors: NDArray[np.float32]
    footprints: NDArray[np.float32]

    @classmethod
    def none(cls) -> DensePoints:
        """No points."""
        return cls(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0, np.float32))

    def __len__(self) -> int:
        return len(self.positions)

    def take(self, index: NDArray) -> DensePoints:
        """Those of an index or mask."""
        return DensePoints(self.positions[index], self.colors[index], self.footprints[index])


def agreeing(maps: DepthMaps, tolerance: float, least: int) -> DensePoints:
    """The pixels whose depth at least `least` neighbours confirm, or all if there are fewer.

    Args:
        tolerance: relative difference of depth that still agrees.
    """
    found = [DensePoints.none()]
    for index, view in enumerate(maps.views):
        inverse = maps.inverse_depths[index]
        y, x = np.nonzero(inverse > 0.0)
        depth = 1.0 / inverse[y, x].astype(np.float64)
        places = view.unproject(x + 0.5, y + 0.5, depth)
        neighbours = [int(i) for i in maps.neighbours[index] if i >= 0]
        votes = np.zeros(len(places), int)
        for other in neighbours:
            pixels, seen_depth, inside = maps.views[other].project(places)
            column, row = pixels[inside].astype(int).T
            theirs = maps.inverse_depths[other][row, column]
            votes[inside] += np.abs(theirs * seen_depth[inside] - 1.0) < tolerance
        kept = votes >= max(min(least, len(neighbours)), 1)
        footprint = depth[kept] / np.sqrt(view.camera.fx * view.camera.fy)
        colors = view.image[y, x, :3][kept]
        found.append(DensePoints(places[kept].astype(np.float32), colors, footprint.astype(np.float32)))
    return DensePoints(
        np.concatenate([points.positions for points in found]),
        np.concatenate([points.colors for points in found]),
        np.concatenate([points.footprints for points in found]),
    )


def thinned(points: DensePoints, count: int, occupied: NDArray[np.float32] | None = None) -> DensePoints:
    """At most `count` of the points, spread over the surfaces in proportion to how finely they are seen.

    One point is kept in a cube whose side is a multiple of its pixel's footprint, rounded to a power of two; where the
    same place is seen from near and from far, the nearer one stays.

    Args:
        occupied: (P, 3) positions in whose cubes no point is needed.
    """
    if count <= 0 or not len(points):
        return DensePoints.none()
    taken = np.zeros((0, 3), np.float32) if occupied is None else occupied
    chosen = _one_in_a_cube(points, 1.0, taken)
    if len(chosen) <= count:
        return points.take(chosen)
    low, high = 0.0, _COARSEST
    chosen = chosen[:0]
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2.0
        kept = _one_in_a_cube(points, 2.0**middle, taken)
        if len(kept) > count:
            low = middle
            continue
        high, chosen = middle, kept
        if len(kept) > _FULL * count:
            break
    return points.take(chosen)


def _one_in_a_cube(points: DensePoints, multiple: float, occupied: NDArray[np.float32]) -> NDArray[np.int64]:
    """Indices of the points that stay: the finest of each cube, unless there is a finer cube's or an occupied place."""
    size = np.log2(points.footprints.astype(np.float64) * multiple)
    finest = float(size.min())
    level = np.floor(size - finest).astype(np.int64)
    fine_first = np.argsort(points.footprints, kind="stable")
    chosen: list[NDArray[np.int64]] = []
    taken = occupied
    for coarseness in range(int(level.max()) + 1):
        index = fine_first[level[fine_first] == coarseness]
        side = 2.0 ** (finest + coarseness)
        cubes, first = np.unique(_cubes(points.positions[index], side), return_index=True)
        kept = index[first[~np.isin(cubes, _cubes(taken, side))]]
        chosen.append(kept)
        taken = np.concatenate([taken, points.positions[kept]])
    return np.sort(np.concatenate(chosen))


def _cubes(positions: NDArray[np.float32], side: float) -> NDArray[np.int64]:
    """(N,) a number for the cube of each of (N, 3) positions; two cubes far apart may share one, which does no harm."""
    x, y, z = np.floor(positions.astype(np.float64) / side).astype(np.int64).T & _CUBE_MASK
    return (x << 42) | (y << 21) | z
