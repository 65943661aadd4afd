"""Technical quality of photographs: noise, blur, compression, darkness. numpy and scipy only.

Everything is measured on the pixels that a run uses, so what downscaling has removed does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, shift

from ..color.noise import luma, noise_level

_JPEG_BLOCK = 8
_ALIGN_BLUR = 1.5  # pixels
_ALIGN_ROUNDS = 4
_TILES = 3  # per side
_AGREEMENT = 1.5  # least median shift, in units of the tiles' scatter, at which they agree
_COVERED = 128  # of 255: a pixel that shows the subject
_MOST_CONDITION = 1e6  # of a tile's gradients; beyond it they do not determine one direction


@dataclass(frozen=True)
class PhotographQuality:
    """Medians over photographs.

    Attributes:
        noise: standard deviation in the flattest parts, in levels of 255.
        sharpness: energy of the differences between neighbouring pixels relative to that between means of two, without
            the energy of noise, in the direction where it is lowest; 0.25 for a smooth ramp, NaN if all are flat.
        blocks: differences across the borders of JPEG's blocks relative to those inside; 1 without compression.
        brightness: median luma in [0, 1] of the covered pixels.
    """

    noise: float
    sharpness: float
    blocks: float
    brightness: float

    @classmethod
    def of(
        cls, photographs: Sequence[NDArray[np.uint8]], alphas: Sequence[NDArray[np.uint8] | None] | None = None
    ) -> PhotographQuality:
        """Measure (H, W, 3) images; `alphas` are (H, W), None for images without uncovered pixels.

        Cut-out photographs are black around their subject, which says nothing about the light.
        """
        lumas = [luma(image) for image in photographs]
        noises = [noise_level(image) for image in lumas]
        covered = [
            image if alpha is None or not (alpha >= _COVERED).any() else image[alpha >= _COVERED]
            for image, alpha in zip(lumas, alphas or [None] * len(lumas), strict=True)
        ]
        sharpnesses = [sharpness(image, noise) for image, noise in zip(lumas, noises, strict=True)]
        known = [value for value in sharpnesses if np.isfinite(value)]  # a black photograph says nothing of blur
        return cls(
            noise=float(np.median(noises)),
            sharpness=float(np.median(known)) if known else float("nan"),
            blocks=float(np.median([blockiness(image) for image in lumas])),
            brightness=float(np.median([np.median(values) for values in covered])) / 255.0,
        )


def sharpness(image: NDArray[np.float64], noise: float) -> float:
    """See `PhotographQuality`; NaN if there is nothing but noise."""
    rows, columns = (side // 2 * 2 for side in image.shape)
    halved = image[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3))
    ratios = []
    for axis in (0, 1):
        fine = (np.diff(image, axis=axis) ** 2).mean() - 2.0 * noise**2
        coarse = (np.diff(halved, axis=axis) ** 2).mean() - 0.5 * noise**2
        if fine > 0.0 and coarse > 0.0:
            ratios.append(fine / coarse)
    return float(min(ratios)) if ratios else float("nan")


def blockiness(image: NDArray[np.float64]) -> float:
    """See `PhotographQuality`; of differences of neighbours, which a ramp makes the same within blocks and between."""
    found = []
    for axis in (0, 1):
        jumps = np.abs(np.diff(image, axis=axis))
        jumps = jumps.mean(axis=1 - axis)
        border = np.arange(len(jumps)) % _JPEG_BLOCK == _JPEG_BLOCK - 1
        if border.sum() > 1 and jumps[~border].mean() > 0.0:
            found.append(jumps[border].mean() / jumps[~border].mean())
    return float(np.mean(found)) if found else 1.0


def image_shift(rendered: NDArray[np.uint8], photograph: NDArray[np.uint8]) -> float:
    """Shift in pixels between a photograph and a rendering; 0 where the parts of the image do not agree on it.

    Least squares of Lucas and Kanade (1981) on tiles of the image; a rotated camera moves most of them alike.
    """
    first, second = (gaussian_filter(luma(image), _ALIGN_BLUR) for image in (rendered, photograph))
    shifts = np.array([_tile_shift(*tiles) for tiles in zip(_tiles(first), _tiles(second), strict=True)])
    middle = np.median(shifts, axis=0)
    scatter = float(np.linalg.norm(np.median(np.abs(shifts - middle), axis=0)))
    length = float(np.linalg.norm(middle))
    return length if length > _AGREEMENT * scatter else 0.0


def _tile_shift(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) shift of `second` relative to `first` in rows and columns."""
    down, right = np.gradient(second)
    slopes = np.stack([down.ravel(), right.ravel()])
    normal = slopes @ slopes.T
    if np.linalg.cond(normal) > _MOST_CONDITION:
        return np.zeros(2)
    found = np.zeros(2)
    for _ in range(_ALIGN_ROUNDS):
        difference = shift(second, -found, order=1, mode="nearest") - first
        found -= np.linalg.solve(normal, slopes @ difference.ravel())
    return found


def _tiles(image: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    return [tile for band in np.array_split(image, _TILES, axis=0) for tile in np.array_split(band, _TILES, axis=1)]
