"""Selecting, turning and dividing Gaussians: what strategies are made of. numpy only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians

# A Gaussian of unit variance is divided along its longest axis into two at ± this that keep mean and variance.
DIVISION_OFFSET = 0.7
DIVISION_SHRINK = float(np.sqrt(1.0 - DIVISION_OFFSET**2))


def finite(gaussians: Gaussians) -> NDArray[np.bool_]:
    """(N,) whether every parameter of the Gaussian is a finite number."""
    parts = (gaussians.means, gaussians.log_scales, gaussians.quaternions, gaussians.opacity_logits, gaussians.sh)
    return np.logical_and.reduce([np.isfinite(part).reshape(len(gaussians), -1).all(axis=1) for part in parts])


def rotate(quaternions: NDArray[np.floating], vectors: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N, 3) vectors turned by (N, 4) wxyz quaternions of any length but zero."""
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    w, axis = unit[:, :1], unit[:, 1:]
    across = 2.0 * np.cross(axis, vectors)
    return vectors + w * across + np.cross(axis, across)


def divide(gaussians: Gaussians) -> tuple[Gaussians, Gaussians]:
    """Every Gaussian as two, side by side along its longest axis, of the same mean and variance together."""
    rows = np.arange(len(gaussians))
    longest = gaussians.log_scales.argmax(axis=1)
    offset = np.zeros((len(gaussians), 3), np.float32)
    offset[rows, longest] = DIVISION_OFFSET * np.exp(gaussians.log_scales[rows, longest])
    offset = rotate(gaussians.quaternions, offset).astype(np.float32)
    log_scales = gaussians.log_scales.copy()
    log_scales[rows, longest] += np.float32(np.log(DIVISION_SHRINK))
    return (
        replace(gaussians, means=gaussians.means + offset, log_scales=log_scales),
        replace(gaussians, means=gaussians.means - offset, log_scales=log_scales),
    )


def concatenate(*sets: Gaussians) -> Gaussians:
    """The Gaussians of all `sets`, one set after the other."""
    return Gaussians(
        np.concatenate([part.means for part in sets]),
        np.concatenate([part.log_scales for part in sets]),
        np.concatenate([part.quaternions for part in sets]),
        np.concatenate([part.opacity_logits for part in sets]),
        np.concatenate([part.sh for part in sets]),
    )


def covariance_product(gaussians: Gaussians, vectors: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N, 3) vectors multiplied by the Gaussians' covariances R S² Rᵀ."""
    conjugate = gaussians.quaternions * np.array([1.0, -1.0, -1.0, -1.0], np.float32)
    local = rotate(conjugate, vectors) * np.exp(2.0 * gaussians.log_scales.astype(np.float64))
    return rotate(gaussians.quaternions, local)
