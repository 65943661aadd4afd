"""Photographs made smaller."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Below one step of 8 bits a straight colour is rounding alone.
_LEAST_COVERAGE = 1.0 / 255.0
# A camera file and a downscaled photograph round their sizes differently, by this many pixels.
_ROUNDING = 1.5


def fit_size(width: int, height: int, max_size: int | None) -> tuple[int, int]:
    """(width, height) with the longer side at most `max_size`; never larger than given."""
    longer = max(width, height)
    if max_size is None or longer <= max_size:
        return width, height
    return max(1, round(width * max_size / longer)), max(1, round(height * max_size / longer))


def same_aspect(first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Whether the size `second` is `first`, (width, height) each, scaled uniformly, up to rounding."""
    (width, height), (other_width, other_height) = first, second
    cross_error = abs(width * other_height - height * other_width)
    return cross_error <= _ROUNDING * max(width, height)


def downscale(pixels: NDArray[Any], width: int, height: int) -> NDArray[Any]:
    """Resample (H, W, C) uint8 or float32 to `width` x `height` in one step with an antialiased cubic filter.

    It works on encoded values, not on light: the rasteriser blends encoded colours too, so its mixture of two Gaussians
    in a pixel is the mixture that the filter made, and published PSNR figures are for photographs scaled this way.
    """
    import torch

    if pixels.shape[:2] == (height, width):
        return pixels
    planes = torch.from_numpy(np.ascontiguousarray(pixels)).permute(2, 0, 1)[None]
    scaled = torch.nn.functional.interpolate(planes, size=(height, width), mode="bicubic", antialias=True)
    return np.ascontiguousarray(scaled[0].permute(1, 2, 0).numpy())


def downscale_with_alpha(
    image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None, width: int, height: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """`downscale` for straight colours: what is not covered does not bleed into what is."""
    if alpha is None or image.shape[:2] == (height, width):
        return downscale(image, width, height), alpha
    coverage = alpha[..., None].astype(np.float32) / 255.0
    premultiplied = downscale(image.astype(np.float32) * coverage, width, height)
    coverage = downscale(coverage, width, height)
    straight = np.clip(np.rint(premultiplied / np.maximum(coverage, _LEAST_COVERAGE)), 0, 255).astype(np.uint8)
    colors = np.where(coverage > _LEAST_COVERAGE, straight, downscale(image, width, height))
    return colors, np.clip(np.rint(coverage[..., 0] * 255.0), 0, 255).astype(np.uint8)
