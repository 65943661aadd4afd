"""Renders Gaussians, measures a photometric loss and takes its gradient."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .camera import CAMERA_FLOATS, RasterCamera
from .frame import Frame, Loss
from .kernels_cpu import Stage
from .parameters import FIELDS, Gradients, ParameterSet
from .runner import Runner

TILE_WIDTH, TILE_HEIGHT = 8, 16  # pixels; as in numeric.h
_SPLAT_FLOATS, _MOMENTS = 16, 12  # as in numeric.h
_SORT_HISTOGRAM = 3 * 2048  # passes x buckets of stages_cpu.h
_STRIP_ROWS = 48  # as in loss_cpu.h


def _loss_scratch_floats(width: int) -> int:
    """What one worker needs for its rolling windows; as in loss_cpu.h."""
    stride = (3 * width + 7) // 8 * 8 + 2 * 16
    return (8 * 11 + 4 + 3 + 1) * stride


class Rasterizer:
    """Owns a device, its threads and work space that grows as needed and is used again.

    Args:
        device: "cpu" or "cuda[:n]".
        threads: workers on the CPU; None takes the processors this process may use.
    """

    def __init__(self, device: str = "cpu", threads: int | None = None) -> None:
        self.runner = Runner(device, threads)
        self.device = self.runner.device
        self.threads = self.runner.threads
        self._camera = self.runner.allocate("camera", (CAMERA_FLOATS,), wp.float32).numpy()
        self.runner.allocate("sort_histogram", (_SORT_HISTOGRAM,), wp.int32)
        self._frames: dict[tuple[int, int], dict[str, wp.array]] = {}
        self._gradients: Gradients | None = None
        self._first_slot: NDArray[np.int32] | None = None
        self._partial: NDArray[np.float64] | None = None
        self._loss_width = 0
        self._number = 0

    def render(
        self, params: ParameterSet, camera: RasterCamera, background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Frame:
        """Renders `params` over `background` (sRGB). The frame holds until the next render."""
        state = self.runner.state
        self._bind_parameters(params)
        images = self._bind_images(camera)
        self._camera[:] = camera.packed(background)
        self.runner.run(Stage.PROJECT, len(params) >= 1024)
        self.runner.run(Stage.SORT, False)
        self.runner.run(Stage.COUNT, state.segments > 1)
        self.runner.run(Stage.OFFSETS, False)
        intersections = int(self._first_slot[-1])
        self.runner.reserve("list_gaussian", intersections, wp.int32)
        self.runner.reserve("list_slot", intersections, wp.int32)
        self.runner.reserve("list_rows", intersections, wp.uint8)
        self.runner.run(Stage.LIST, state.segments > 1)
        self.runner.run(Stage.FORWARD)
        self._number += 1
        return Frame(
            camera=camera,
            parameters=params,
            visible=self.runner.array("visible"),
            radii=self.runner.array("radii"),
            intersections=intersections,
            number=self._number,
            **images,
        )

    def photometric_loss(
        self, frame: Frame, target: wp.array, ssim_weight: float = 0.2, mask: wp.array | None = None
    ) -> Loss:
        """(1 - w) L1 + w (1 - SSIM) of the frame's colour against a photograph; fills `frame.grad_color`.

        SSIM has a Gaussian window of 11 pixels, sigma 1.5, zero padding and K = (0.01, 0.03), over the three channels.

        Args:
            target: (H, W, 3) uint8 or float32, display-referred sRGB.
            ssim_weight: w.
            mask: (H, W) float32 weights or uint8 coverage (255 = 1). Both images are multiplied by it, so that what
                the photograph does not cover is to SSIM as what lies outside the image, and the means are weighted.
        """
        self._require_current(frame)
        state = self.runner.state
        height, width = frame.camera.height, frame.camera.width
        if target.shape != (height, width, 3):
            raise ValueError(f"target has shape {target.shape}, the frame {(height, width, 3)}")
        state.target_is_bytes = int(target.dtype == wp.uint8)
        self.runner.bind("target_bytes" if state.target_is_bytes else "target_floats", target)
        weight = float(height * width)
        state.mask_kind = 0
        if mask is not None:
            if mask.shape != (height, width):
                raise ValueError(f"mask has shape {mask.shape}, the frame {(height, width)}")
            is_bytes = mask.dtype == wp.uint8
            state.mask_kind = 2 if is_bytes else 1
            self.runner.bind("mask_bytes" if is_bytes else "mask_floats", mask)
            weight = float(mask.numpy().sum(dtype=np.float64)) / (255.0 if is_bytes else 1.0)
        scale = 1.0 / (3.0 * weight) if weight > 0.0 else 0.0
        state.l1_scale = (1.0 - ssim_weight) * scale
        state.ssim_scale = ssim_weight * scale
        self._reserve_loss(width, height)
        self.runner.run(Stage.LOSS)
        l1, ssim = (float(part) * scale for part in self._partial.sum(axis=0))
        if weight <= 0.0:
            ssim = 1.0
        return Loss(total=(1.0 - ssim_weight) * l1 + ssim_weight * (1.0 - ssim), l1=l1, ssim=ssim)

    def backward(
        self,
        frame: Frame,
        *,
        grad_color: wp.array | None = None,
        grad_depth: wp.array | None = None,
        grad_alpha: wp.array | None = None,
        colors_only: bool = False,
        absolute: bool = False,
    ) -> Gradients:
        """Gradients of the parameters from those of the images; they hold until the next call.

        Args:
            grad_color: (H, W, 3) float32; `frame.grad_color` when None.
            grad_depth, grad_alpha: (H, W) float32, zero when None.
            colors_only: only `sh[:, 0]`, for fitting colours to fixed geometry.
            absolute: fill `screen_abs` too, which takes a tenth longer.
        """
        self._require_current(frame)
        state = self.runner.state
        params = frame.parameters
        gradients = replace(self._bind_gradients(len(params), params.sh_count), colors_only=colors_only)
        self.runner.bind("grad_color", frame.grad_color if grad_color is None else grad_color)
        state.with_depth = int(not (grad_depth is None and grad_alpha is None))
        if state.with_depth:
            zeros = wp.zeros(frame.depth.shape, dtype=wp.float32, device=self.device)
            self.runner.bind("grad_depth", zeros if grad_depth is None else grad_depth)
            self.runner.bind("grad_alpha", zeros if grad_alpha is None else grad_alpha)
        state.colors_only = int(colors_only)
        state.absolute = int(absolute)
        self.runner.reserve("moments", frame.intersections, wp.float32, _MOMENTS)
        self.runner.run(Stage.BACKWARD)
        self.runner.run(Stage.GATHER, len(params) >= 1024)
        return gradients

    def _bind_parameters(self, params: ParameterSet) -> None:
        count = len(params)
        if params.device != self.device:
            raise ValueError(f"the Gaussians are on {params.device}, the rasteriser on {self.device}")
        for name in FIELDS:
            self.runner.bind(name, getattr(params, name))
        state = self.runner.state
        state.sh_count = params.sh_count
        if self._first_slot is not None and len(self._first_slot) == count + 1:
            return
        state.gaussians = count
        # Segments are shared out among the threads; more than there are threads evens out a busy neighbour.
        state.segments = 2 * self.threads if count >= 4096 else 1
        self.runner.allocate("splats", (count, _SPLAT_FLOATS), wp.float32)
        self.runner.allocate("keys", (count,), wp.uint32)
        self.runner.allocate("order", (count,), wp.int32)
        self.runner.allocate("sort_scratch", (count,), wp.int32)
        self.runner.allocate("visible", (count,), wp.uint8)
        self.runner.allocate("radii", (count,), wp.float32)
        self._first_slot = self.runner.allocate("first_slot", (count + 1,), wp.int32).numpy()

    def _bind_images(self, camera: RasterCamera) -> dict[str, wp.array]:
        state = self.runner.state
        width, height = camera.width, camera.height
        if (width, height) not in self._frames:
            shapes = {"color": (height, width, 3), "depth": (height, width), "alpha": (height, width)}
            shapes["grad_color"] = shapes["color"]
            self._frames[width, height] = {
                name: wp.zeros(shape, dtype=wp.float32, device=self.device) for name, shape in shapes.items()
            }
        images = self._frames[width, height]
        for name, array in images.items():
            self.runner.bind(name, array)
        state.width, state.height = width, height
        state.tiles_x = -(-width // TILE_WIDTH)
        state.tiles = state.tiles_x * -(-height // TILE_HEIGHT)
        self.runner.reserve("tile_histogram", state.tiles * state.segments, wp.int32)
        self.runner.reserve("tile_start", state.tiles + 1, wp.int32)
        return images

    def _bind_gradients(self, count: int, sh_count: int) -> Gradients:
        if self._gradients is None or self._gradients.sh.shape[:2] != (count, sh_count):
            zeros = ParameterSet.zeros(count, sh_count, self.device)
            self._gradients = Gradients(
                *(getattr(zeros, name) for name in FIELDS),
                screen=wp.zeros(count, dtype=wp.float32, device=self.device),
                screen_abs=wp.zeros(count, dtype=wp.float32, device=self.device),
                touched=wp.zeros(count, dtype=wp.uint8, device=self.device),
            )
        gradients = self._gradients
        for name in (*FIELDS, "screen", "screen_abs"):
            self.runner.bind(f"grad_{name}", getattr(gradients, name))
        self.runner.bind("touched", gradients.touched)
        return gradients

    def _reserve_loss(self, width: int, height: int) -> None:
        # The padding of the rows has to be zero and moves with the width.
        if self._loss_width != width:
            self.runner.allocate("loss_scratch", (self.threads * _loss_scratch_floats(width),), wp.float32)
            self._loss_width = width
        strips = -(-height // _STRIP_ROWS)
        if self._partial is None or len(self._partial) != strips:
            self._partial = self.runner.allocate("loss_partial", (strips, 2), wp.float64).numpy()

    def _require_current(self, frame: Frame) -> None:
        if frame.number != self._number:
            raise ValueError("the frame is not the rasteriser's latest: its arrays have been written over")
