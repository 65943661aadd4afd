"""The similarity that brings points onto others: how two captures of the same place fit together. numpy only.

Least squares in closed form: S. Umeyama, Least-squares estimation of transformation parameters between two point
patterns, IEEE PAMI 13 (1991).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

FEWEST = 3
"""Pairs of points that a similarity needs, not all on a line."""

_LEAST_WIDTH = 1e-3  # of the second principal axis over the first; less is a line


@dataclass(frozen=True)
class Similarity:
    """A fit.

    Attributes:
        matrix: (4, 4) takes sources to targets.
        scale: that is in it, positive.
        residuals: (N,) distances that are left, in the targets' unit.
    """

    matrix: NDArray[np.float64]
    scale: float
    residuals: NDArray[np.float64]

    @property
    def error(self) -> float:
        """Root of the mean squared residual."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fit_similarity(sources: ArrayLike, targets: ArrayLike, *, with_scale: bool = True, where: str = "") -> Similarity:
    """The rotation, the translation and the scale that bring `sources` closest to `targets`.

    Args:
        sources, targets: (N, 3) points, pair by pair.
        with_scale: whether sizes may differ; else the scale is one.
        where: what a complaint names.

    Raises:
        InputError: fewer than three pairs, points on one line, or values that are not finite.
    """
    source, target = np.asarray(sources, np.float64).reshape(-1, 3), np.asarray(targets, np.float64).reshape(-1, 3)
    if len(source) != len(target) or len(source) < FEWEST:
        what = f"{min(len(source), len(target))} pairs of points"
        raise InputError(what, where=where, remedy=f"give at least {FEWEST}")
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise InputError("some points are not finite numbers", where=where, remedy="move them back")
    if not (_spans_a_plane(source) and _spans_a_plane(target)):
        raise InputError("the points lie on one line", where=where, remedy="choose one of them beside it")
    source_center, target_center = source.mean(axis=0), target.mean(axis=0)
    moved, fixed = source - source_center, target - target_center
    left, spread, right = np.linalg.svd(fixed.T @ moved / len(source))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = left * signs @ right
    scale = float(spread @ signs / np.mean((moved**2).sum(axis=1))) if with_scale else 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation
    matrix[:3, 3] = target_center - scale * rotation @ source_center
    residuals = np.linalg.norm(source @ matrix[:3, :3].T + matrix[:3, 3] - target, axis=1)
    return Similarity(matrix, scale, residuals)


def _spans_a_plane(points: NDArray[np.float64]) -> bool:
    widths = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(widths[1] > _LEAST_WIDTH * widths[0] > 0.0)
