"""What the networks are told besides the image: who looks (the observer), and which colours the whole scene has."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...color.simulation import Observer
from ...color.spaces import srgb_to_lab
from ...settings import CVD_TYPES, SIMULATIONS
from ..lut import as_float
from .nodes import scatter_trilinear

OBSERVER_FEATURES = len(CVD_TYPES) + len(SIMULATIONS)
"""Length of an observer's vector."""

PALETTE_BINS = 4
"""Bins of the palette's histogram along each channel of sRGB."""

PALETTE_FEATURES = PALETTE_BINS**3 + 9
"""Length of a palette."""

CONDITION_FEATURES = OBSERVER_FEATURES + PALETTE_FEATURES + 1
"""Length of a scene's condition."""

_PALETTE_PIXELS = 4_000  # drawn from each image for its palette
_LAB_CENTER, _LAB_SCALE = np.array([50.0, 0.0, 0.0]), 20.0  # bring CIELAB to the order of 1


def observer_features(observer: Observer) -> Tensor:
    """(OBSERVER_FEATURES,): the severity in the place of the type, and which simulation model is meant."""
    kind = [observer.severity * (observer.cvd == name) for name in CVD_TYPES]
    model = [float(observer.simulation == name) for name in SIMULATIONS]
    return torch.tensor([*kind, *model], dtype=torch.float32)


def condition(observer: Observer, colors: Tensor, budget: float) -> Tensor:
    """(CONDITION_FEATURES,) for a scene: the observer, the scene's `palette`, and the budget in mean ΔE00."""
    return torch.cat([observer_features(observer), colors, torch.tensor([math.log(budget)])])


def palette(
    images: Sequence[NDArray], alphas: Sequence[NDArray[np.uint8] | None] | None = None, seed: int = 0
) -> Tensor:
    """(PALETTE_FEATURES,) the scene's colours, whatever the number and the order of its views.

    First a histogram: the square root of each bin's share of the pixels (so that small areas are seen as well), every
    pixel shared out linearly between the eight bins around it (so that a slightly different light changes it only
    slightly). Then mean, deviation and correlations in CIELAB: whether reds are the yellower or the bluer colours of a
    scene decides which way they had better be moved apart from its greens.

    Args:
        images: (H, W, 3) uint8, or float in [0, 1]; all count alike.
        alphas: (H, W) coverage per image or None; uncovered pixels do not count.
        seed: draws the pixels of large images.
    """
    shares, moments = np.zeros(PALETTE_BINS**3), np.zeros((4, 4))
    generator = np.random.default_rng(seed)
    for view, image in enumerate(images):
        alpha = None if alphas is None else alphas[view]
        colors = image.reshape(-1, 3) if alpha is None else image[np.asarray(alpha) > 0]
        if len(colors) > _PALETTE_PIXELS:
            colors = colors[generator.integers(0, len(colors), _PALETTE_PIXELS)]
        if len(colors):
            shares += _histogram(as_float(colors)) / len(colors)
            moments += _moments(as_float(colors))
    total = shares.sum()
    if not total:
        return torch.zeros(PALETTE_FEATURES)
    features = np.concatenate([np.sqrt(shares / total), _statistics(moments / moments[0, 0])])
    return torch.from_numpy(features.astype(np.float32))


def _moments(colors: NDArray[np.float32]) -> NDArray[np.float64]:
    """(4, 4) mean of the outer products of (1, L, a, b), L, a and b brought to the order of 1."""
    lab = srgb_to_lab(torch.from_numpy(colors.T.copy())[..., None])[..., 0].double().numpy().T
    extended = np.column_stack([np.ones(len(lab)), (lab - _LAB_CENTER) / _LAB_SCALE])
    return extended.T @ extended / len(lab)


def _statistics(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """(9,) means, standard deviations and correlations (L-a, L-b, a-b)."""
    mean = moments[0, 1:]
    covariance = moments[1:, 1:] - np.outer(mean, mean)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    correlation = covariance / (np.outer(deviation, deviation) + 1e-3)  # near 0 where a scene has no such contrast
    return np.concatenate([mean, deviation, correlation[np.triu_indices(3, 1)]])


def _histogram(colors: NDArray[np.float32]) -> NDArray[np.float64]:
    """(PALETTE_BINS^3,) of (P, 3) colours."""
    ones = torch.ones(1, 1, len(colors), dtype=torch.float64)
    return scatter_trilinear(ones, torch.from_numpy(colors.T)[None], PALETTE_BINS)[0, 0].numpy()
