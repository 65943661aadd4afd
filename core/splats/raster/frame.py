"""The camera and mask that a render and its loss take, and the frame and loss that they return."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..scene_frame import NEAR
from .parameters import ParameterSet

CAMERA_FLOATS = 27  # length of `RasterCamera.packed`
# The perspective is linearised within 1.3 times the field of view (Kerbl et al. 2023): beyond it a Gaussian's footprint
# would grow without bound.
_FIELD_OF_VIEW_MARGIN = 0.3


@dataclass(frozen=True)
class RasterCamera:
    """A pinhole camera in OpenCV axes; pixel centres lie at +0.5.

    Attributes:
        width, height: of the image, pixels.
        fx, fy, cx, cy: focal lengths and principal point, pixels.
        world_to_camera: (4, 4), rigid.
        near: near plane: smallest depth drawn, scene units.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: NDArray[np.float64] = field(repr=False)
    near: float = NEAR

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) camera centre in the world."""
        matrix = np.asarray(self.world_to_camera, np.float64)
        return -matrix[:3, :3].T @ matrix[:3, 3]

    def zoomed(self, factor: float) -> RasterCamera:
        """The same camera with its focal lengths multiplied by `factor`."""
        return replace(self, fx=self.fx * factor, fy=self.fy * factor)

    def packed(self, background: tuple[float, float, float]) -> NDArray[np.float32]:
        """The floats of `Camera` in projection.h, in its order."""
        matrix = np.asarray(self.world_to_camera, np.float64)
        margin_x = _FIELD_OF_VIEW_MARGIN * 0.5 * self.width / self.fx
        margin_y = _FIELD_OF_VIEW_MARGIN * 0.5 * self.height / self.fy
        return np.array(
            [
                *matrix[:3, :3].ravel(),
                *matrix[:3, 3],
                *self.center,
                self.fx,
                self.fy,
                self.cx,
                self.cy,
                self.near,
                -self.cx / self.fx - margin_x,
                (self.width - self.cx) / self.fx + margin_x,
                -self.cy / self.fy - margin_y,
                (self.height - self.cy) / self.fy + margin_y,
                *background,
            ],
            np.float32,
        )


@dataclass(frozen=True)
class Mask:
    """Weight of each pixel in the loss.

    Attributes:
        pixels: (H, W) float32 weights or uint8 coverage (255 = 1), on the rasteriser's device.
        total: the sum of the weights.
    """

    pixels: wp.array
    total: float

    @classmethod
    def of(cls, weights: NDArray[np.float32] | NDArray[np.uint8], device: wp.Device | str = "cpu") -> Mask:
        """The mask of (H, W) `weights`, whose memory it shares where it can."""
        is_bytes = weights.dtype == np.uint8
        total = float(weights.sum(dtype=np.float64)) / (255.0 if is_bytes else 1.0)
        kind = wp.uint8 if is_bytes else wp.float32
        return cls(wp.array(weights, dtype=kind, device=device, copy=False), total)


@dataclass(frozen=True)
class Frame:
    """A rendered image; its arrays belong to the `Rasterizer` and are valid until its next render.

    Attributes:
        camera: the view.
        parameters: the Gaussians rendered.
        color: (H, W, 3) float32, sum of weight * colour over the background.
        depth: (H, W) float32, sum of weight * camera z, scene units; divide by `alpha` for the mean depth.
        alpha: (H, W) float32, sum of the weights.
        visible: (N,) uint8, 1 where the Gaussian may reach a pixel.
        radii: (N,) float32, pixels, three standard deviations along the major axis; 0 where not visible.
        grad_color: (H, W, 3) float32, dL/dcolor as `Rasterizer.photometric_loss` leaves it.
        intersections: of Gaussians with tiles; time and memory are proportional to it.
        number: of the render, to recognise frames that are no longer valid.
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
    """The photometric loss; computed only on access, since on a GPU the host has to wait for it.

    Attributes:
        read: returns L1 and SSIM, means over the (masked) image.
        ssim_weight: w of (1 - w) L1 + w (1 - SSIM).
    """

    read: Callable[[], tuple[float, float]]
    ssim_weight: float

    @cached_property
    def _parts(self) -> tuple[float, float]:
        return self.read()

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
        return (1.0 - self.ssim_weight) * self.l1 + self.ssim_weight * (1.0 - self.ssim)
