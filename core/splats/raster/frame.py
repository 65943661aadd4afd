"""What a render and its loss hand back."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from .camera import RasterCamera
from .parameters import ParameterSet


@dataclass(frozen=True)
class Frame:
    """A rendered image; its arrays belong to the `Rasterizer` and hold until its next render.

    Attributes:
        camera: it was rendered from.
        parameters: that were rendered.
        color: (H, W, 3) float32, sum of weight * colour over the background.
        depth: (H, W) float32, sum of weight * camera z, scene units; divide by `alpha` for the mean depth.
        alpha: (H, W) float32, sum of the weights.
        visible: (N,) uint8, 1 where the Gaussian can reach a pixel.
        radii: (N,) float32, pixels, three standard deviations along the major axis; 0 where not visible.
        grad_color: (H, W, 3) float32, dL/dcolor as `Rasterizer.photometric_loss` leaves it.
        intersections: of Gaussians with tiles, what time and memory go with.
        number: counts the renders of the rasteriser.
    """

    camera: RasterCamera
    parameters: ParameterSet
    color: wp.array
    depth: wp.array
    alpha: wp.array
    visible: wp.array
    radii: wp.array
    grad_color: wp.array
    intersections: int
    number: int


@dataclass(frozen=True)
class Loss:
    """Parts of the photometric loss; `total` = (1 - w) l1 + w (1 - ssim)."""

    total: float
    l1: float
    ssim: float
