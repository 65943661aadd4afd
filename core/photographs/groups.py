"""Tells by their colours which photographs belong to one scene, so that unrelated ones are not enhanced as if they did.

Photographs whose palettes are alike are linked, and what is linked, over however many steps, is one scene: from one
side of an object to the other, palettes change gradually. A photograph on its own, such as of a bare wall, still joins
a scene that it resembles less, where that scene is beyond doubt.

The thresholds were chosen on the demo and six other captures, each of which stays one scene (also with every run of
five or ten of its views, except in a room whose walls differ), while of twelve Kodak photographs two are linked, and of
eleven fruit photographs and forty colour plates none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.sparse.csgraph import connected_components

from ..capture.scaling import downscale_with_alpha, fit_size
from ..color.spaces import srgb_to_lab

_SIZE = 96  # pixels of the longer side of the copy whose colours are counted
_LIGHTNESS_STEP, _CHROMA_STEP = 20.0, 8.0  # of the palette, in CIELAB
_LIGHTNESS_BLUR, _CHROMA_BLUR = 0.7, 1.0  # steps; the same cloth is never the same shade twice
_CHROMA_END = 112.0  # CIELAB; sRGB's blue has b* = -108
# Hellinger distances of palettes, 0 for equal ones and 1 for those without a common colour.
_LINKED = 0.22
_LINKED_PAIR = 0.13  # more for two photographs, and less with their number: fewer views lie further apart
_RESEMBLING = 0.35  # to join a scene beyond doubt ...
_BEYOND_DOUBT = 3  # ... which is one of so many linked photographs

Pixels = NDArray[np.uint8]


def group_by_palette(images: Sequence[Pixels], alphas: Sequence[Pixels | None]) -> list[int]:
    """The scene that each photograph belongs to, numbered in the order of their first photographs.

    Args:
        images: (H, W, 3) each.
        alphas: (H, W) coverage or None each; uncovered pixels do not count.
    """
    if not images:
        return []
    roots = np.sqrt(np.stack([_palette(image, alpha) for image, alpha in zip(images, alphas, strict=True)]))
    distance = np.sqrt(np.clip(1.0 - roots @ roots.T, 0.0, None))
    linked = distance <= _LINKED + _LINKED_PAIR * 2.0 / len(images)
    _, group = connected_components(linked, directed=False)
    _join_certain(group, distance)
    _, first, inverse = np.unique(group, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse].tolist()


def _join_certain(group: NDArray, distance: NDArray) -> None:
    """Let groups that are too small to be sure of join the nearest scene that they resemble, nearest first."""
    certain = np.bincount(group)[group] >= _BEYOND_DOUBT
    while certain.any() and not certain.all():
        between = distance[np.ix_(~certain, certain)]
        nearest = np.unravel_index(between.argmin(), between.shape)
        if between[nearest] > _RESEMBLING:
            return
        joining = group == group[np.flatnonzero(~certain)[nearest[0]]]
        group[joining] = group[np.flatnonzero(certain)[nearest[1]]]
        certain |= joining


def _palette(image: Pixels, alpha: Pixels | None) -> NDArray[np.float64]:
    """Shares of a photograph's pixels in the cells of CIELAB, blurred; they sum to 1."""
    image, alpha = downscale_with_alpha(image, alpha, *fit_size(image.shape[1], image.shape[0], _SIZE))
    pixels = torch.from_numpy(np.ascontiguousarray(image.reshape(-1, 3).T)).float()[..., None] / 255.0
    axes = [
        np.arange(0.0, 100.0 + _LIGHTNESS_STEP, _LIGHTNESS_STEP),
        *[np.arange(-_CHROMA_END, _CHROMA_END + _CHROMA_STEP, _CHROMA_STEP)] * 2,
    ]
    weights = None if alpha is None else alpha.reshape(-1).astype(np.float64)
    counts, _ = np.histogramdd(srgb_to_lab(pixels)[..., 0].T.numpy(), axes, weights=weights)
    blurred = gaussian_filter(counts, (_LIGHTNESS_BLUR, _CHROMA_BLUR, _CHROMA_BLUR)).ravel()
    return blurred / max(blurred.sum(), np.finfo(np.float64).tiny)
