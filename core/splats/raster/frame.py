"""What a render and its loss hand back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

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


class Loss:
    """Parts of the photometric loss. On a GPU the host waits for them, so they are read when they are asked for.

    Args:
        read: gives L1 and SSIM, means over the (masked) image.
        ssim_weight: w of (1 - w) L1 + w (1 - SSIM).
    """

    def __init__(self, read: Callable[[], tuple[float, float]], ssim_weight: float) -> None:
        self._read = read
        self._ssim_weight = ssim_weight

    @cached_property
    def _parts(self) -> tuple[float, float]:
        return self._read()

    @property
    def l1(self) -> float:
        """Mean absolute difference."""
        return self._parts[0]

    @property
    def ssim(self) -> float:
        """Mean structural similarity."""
        return self._parts[1]

    @property
    def total(self) -> float:
        """(1 - w) L1 + w (1 - SSIM)."""
        return (1.0 - self._ssim_weight) * self.l1 + self._ssim_weight * (1.0 - self.ssim)


@dataclass(frozen=True)
class Mask:
    """How much each pixel counts.

    Attributes:
        pixels: (H, W) float32 weights or uint8 coverage (255 = 1), on the rasteriser's device.
        total: the sum of the weights.
    """

    pixels: wp.array
    total: float

    @classmethod
    def of(cls, weights: NDArray[np.float32] | NDArray[np.uint8], device: wp.Device | str = "cpu") -> Mask:
        """The mask of (H, W) `weights`."""
        is_bytes = weights.dtype == np.uint8
        total = float(weights.sum(dtype=np.float64)) / (255.0 if is_bytes else 1.0)
        return cls(wp.array(weights, dtype=wp.uint8 if is_bytes else wp.float32, device=device), total)
