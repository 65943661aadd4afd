"""Operations on sets of Gaussians that strategies are made of: rotate, divide, concatenate, order. numpy only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians
from .model import Refinement

# Halves lie at ± this many standard deviations along the longest axis, along which they keep mean and variance.
_DIVISION_OFFSET = 0.7
_DIVISION_SHRINK = float(np.sqrt(1.0 - _DIVISION_OFFSET**2))
# The other axes are divided by this: two halves as wide as the whole would cover 1.4 times its area.
_DIVISION_NARROWING = 1.6
_MORTON_BITS = 10  # per axis
# Shift and mask, one after the other, spread the bits of a number to every third place.
_MORTON_SPREADING = ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249))


def finite(gaussians: Gaussians) -> NDArray[np.bool_]:
    """(N,) whether every parameter of the Gaussian is a finite number."""
    parts = vars(gaussians).values()
    return np.logical_and.reduce([np.isfinite(part).reshape(len(gaussians), -1).all(axis=1) for part in parts])


def concatenate(*sets: Gaussians) -> Gaussians:
    """The Gaussians of all `sets`, one set after the other."""
    return Gaussians(*(np.concatenate(parts) for parts in zip(*(vars(part).values() for part in sets), strict=True)))


def divide(gaussians: Gaussians) -> tuple[Gaussians, Gaussians]:
    """Two halves of every Gaussian, side by side along its longest axis, along which they keep mean and variance.

    Along the other axes they are narrower, so that they cover about the area of the whole at the same opacity, and add
    detail instead of fog (measured in docs/trainer/number.md).
    """
    rows = np.arange(len(gaussians))
    longest = gaussians.log_scales.argmax(axis=1)
    offset = np.zeros((len(gaussians), 3), np.float32)
    offset[rows, longest] = _DIVISION_OFFSET * np.exp(gaussians.log_scales[rows, longest])
    offset = rotate(gaussians.quaternions, offset).astype(np.float32)
    log_scales = gaussians.log_scales - np.float32(np.log(_DIVISION_NARROWING))
    log_scales[rows, longest] = gaussians.log_scales[rows, longest] + np.float32(np.log(_DIVISION_SHRINK))
    return (
        replace(gaussians, means=gaussians.means + offset, log_scales=log_scales),
        replace(gaussians, means=gaussians.means - offset, log_scales=log_scales),
    )


def rotate(quaternions: NDArray[np.floating], vectors: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N, 3) vectors rotated by (N, 4) wxyz quaternions of any length but zero."""
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    w, axis = unit[:, :1], unit[:, 1:]
    across = 2.0 * np.cross(axis, vectors)
    return vectors + w * across + np.cross(axis, across)


def covariance_product(gaussians: Gaussians, vectors: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N, 3) vectors multiplied by the Gaussians' covariances R S² Rᵀ."""
    conjugate = gaussians.quaternions * np.array([1.0, -1.0, -1.0, -1.0], np.float32)
    local = rotate(conjugate, vectors) * np.exp(2.0 * gaussians.log_scales.astype(np.float64))
    return rotate(gaussians.quaternions, local)


def in_morton_order(refinement: Refinement) -> Refinement:
    """The same Gaussians in Morton order: those of a tile lie close together, which makes a step a tenth faster."""
    order = morton_order(refinement.gaussians.means)
    return Refinement(refinement.gaussians.take(order), refinement.source[order], refinement.fresh[order])


def morton_order(means: NDArray[np.float32]) -> NDArray[np.int64]:
    """(N,) order of (N, 3) positions along a Z-shaped curve (Morton 1966) through a grid of 1024 cells per axis.

    The grid spans all but the outermost hundredth of the positions, so that outliers do not make it coarse.
    """
    if len(means) == 0:
        return np.zeros(0, np.int64)
    known = np.nan_to_num(means.astype(np.float64), posinf=0.0, neginf=0.0)
    low, high = np.percentile(known, [0.5, 99.5], axis=0)
    cells = np.clip((known - low) / np.maximum(high - low, 1e-30), 0.0, 1.0) * (2**_MORTON_BITS - 1)
    code = np.zeros(len(means), np.uint32)
    for axis in range(3):
        bits = cells[:, axis].astype(np.uint32)
        for shift, mask in _MORTON_SPREADING:
            bits = (bits | bits << np.uint32(shift)) & np.uint32(mask)
        code |= bits << np.uint32(axis)
    return np.argsort(code, kind="stable")
