"""Puts Gaussians that are near each other near each other in memory. numpy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .model import Refinement

_BITS = 10  # an axis
# What spreads the bits of a number three apart: shift, then keep.
_SPREADING = ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249))


def morton_order(means: NDArray[np.float32]) -> NDArray[np.int64]:
    """Order of (N, 3) positions along a Z-shaped curve (Morton 1966) through a grid of 1024 cells an axis.

    The grid spans all but the outermost hundredth of the positions, so that one far away does not make it coarse.
    """
    if len(means) == 0:
        return np.zeros(0, np.int64)
    finite = np.nan_to_num(means.astype(np.float64), posinf=0.0, neginf=0.0)
    low, high = np.percentile(finite, [0.5, 99.5], axis=0)
    cells = np.clip((finite - low) / np.maximum(high - low, 1e-30), 0.0, 1.0) * (2**_BITS - 1)
    code = np.zeros(len(means), np.uint32)
    for axis in range(3):
        bits = cells[:, axis].astype(np.uint32)
        for shift, mask in _SPREADING:
            bits = (bits | bits << np.uint32(shift)) & np.uint32(mask)
        code |= bits << np.uint32(axis)
    return np.argsort(code, kind="stable")


def in_order(refinement: Refinement) -> Refinement:
    """The same Gaussians in Morton order: a tile's are then near each other, which saves a step a tenth of its time."""
    order = morton_order(refinement.gaussians.means)
    return Refinement(refinement.gaussians.take(order), refinement.source[order], refinement.fresh[order])
