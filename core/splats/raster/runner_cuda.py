"""The stages of a step on CUDA."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp
from numpy.typing import NDArray

from . import kernels_cuda as kernels
from .frame import CAMERA_FLOATS
from .runner import MOMENTS, SPLAT_FLOATS, Runner


class CudaRunner(Runner):
    """Stages as kernels with one thread per Gaussian, intersection or pixel; Warp's radix sort and scan between them.

    The host waits once per step, for the number of intersections that sizes the buffers, and for the loss if its value
    is read.
    """

    def __init__(self, device: wp.Device) -> None:
        super().__init__(device)
        self.allocate("camera", (CAMERA_FLOATS,), wp.float32)
        self._intersections = 0

    def set_camera(self, packed: NDArray[np.float32]) -> None:
        self.array("camera").assign(packed)

    def reserve_gaussians(self, count: int) -> None:
        self.allocate("splats", (count, SPLAT_FLOATS), wp.float32)
        # The radix sort needs twice the room.
        self.allocate("keys", (2 * count,), wp.uint32)
        self.allocate("order", (2 * count,), wp.int32)
        self.allocate("slot_count", (count + 1,), wp.int32)
        self.allocate("first_slot", (count + 1,), wp.int32)

    def _launch(self, kernel: wp.Kernel, dim: int | tuple[int, int], *arguments: int, block_dim: int = 256) -> None:
        wp.launch(kernel, dim, inputs=[self.state, *arguments], device=self.device, block_dim=block_dim)

    def render(self) -> int:
        state = self.state
        count, tiles = state.gaussians, state.tiles
        self.reserve("tile_start", tiles + 1, wp.int32)
        self._launch(kernels.project, count)
        wp.utils.radix_sort_pairs(self.array("keys"), self.array("order"), count)
        self._launch(kernels.count_slots, count + 1)  # the last element counts nothing: its scan is the total
        wp.utils.array_scan(self.array("slot_count"), self.array("first_slot"), inclusive=False)
        self._intersections = total = int(self.array("first_slot")[count : count + 1].numpy()[0])
        for name in ("list_slot", "slot_tile"):
            self.reserve(name, 2 * total, wp.int32)
        for name in ("list_gaussian", "slot_owner"):
            self.reserve(name, total, wp.int32)
        self._launch(kernels.fill_slots, count)
        wp.utils.radix_sort_pairs(
            self.array("slot_tile"), self.array("list_slot"), total, end_bit=max(tiles - 1, 1).bit_length()
        )
        if total:
            self._launch(kernels.list_entries, total, total)
        else:
            self.array("tile_start").zero_()
        self._launch(kernels.forward, (tiles, kernels.BLEND_THREADS), block_dim=kernels.BLEND_THREADS)
        return total

    def loss(self) -> Callable[[], NDArray[np.float64]]:
        width, height = self.state.width, self.state.height
        blocks = -(-width // kernels.LOSS_SQUARE) * -(-height // kernels.LOSS_SQUARE)
        self.reserve("ssim_maps", 9 * width * height, wp.float32)
        self.reserve("loss_partial", blocks, wp.float64, 2)
        grid = (blocks, kernels.LOSS_THREADS)
        self._launch(kernels.ssim, grid, block_dim=kernels.LOSS_THREADS)
        self._launch(kernels.loss, grid, block_dim=kernels.LOSS_THREADS)
        partial = wp.clone(self.array("loss_partial")[:blocks])  # the next loss overwrites the original
        return lambda: partial.numpy().sum(axis=0)

    def observe(self) -> None:
        self._launch(kernels.observe, self.state.width * self.state.height)

    def list_pairs(self) -> None:
        self._launch(kernels.list_pairs, self.state.width * self.state.height)

    def contrast(self) -> None:
        self._launch(kernels.contrast, self.state.width * self.state.height)

    def backward(self) -> None:
        self.reserve("moments", self._intersections, wp.float32, MOMENTS)
        tiles = self.state.tiles
        self._launch(kernels.backward, (tiles, kernels.BLEND_THREADS), block_dim=kernels.BLEND_THREADS)
        self._launch(kernels.gather, self.state.gaussians)

    def adam(self) -> None:
        self._launch(kernels.adam, self.state.gaussians)
