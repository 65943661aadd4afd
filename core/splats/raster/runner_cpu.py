"""The stages of a step on the CPU, and the threads that share them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...runtime.resources import available_processors
from .frame import CAMERA_FLOATS
from .kernels_cpu import KERNELS, Stage
from .runner import MOMENTS, SPLAT_FLOATS, Runner
from .workers import WorkerPool

_SORT_HISTOGRAM = 3 * 2048  # passes x buckets; as in stages_cpu.h
_STRIP_ROWS = 48  # as in loss_cpu.h
_FEW = 1024  # Gaussians; fewer are not worth waking the other threads for
_SEGMENTED = 4096  # Gaussians from which binning is split into segments


class CpuRunner(Runner):
    """Stages as native kernels on `threads` threads.

    Recorded launches hold the state by reference, so the next launch only needs its fields changed: wrapping the
    arguments anew would cost more than some of the kernels.
    """

    def __init__(self, device: wp.Device, threads: int | None) -> None:
        super().__init__(device)
        self.threads = threads or available_processors()
        self._pool = WorkerPool(self.threads)
        self._counters = self.allocate("counters", (len(Stage),), wp.int32).numpy()
        self._camera = self.allocate("camera", (CAMERA_FLOATS,), wp.float32).numpy()
        self.allocate("sort_histogram", (_SORT_HISTOGRAM,), wp.int32)
        self._loss_width = 0
        self._partial = np.zeros((0, 2))
        self._launches = {
            stage: [
                wp.launch(kernel, 1, inputs=[self.state, worker], device=device, record_cmd=True).launch
                for worker in range(self.threads)
            ]
            for stage, kernel in KERNELS.items()
        }

    def run(self, stage: Stage, parallel: bool = True) -> None:
        """Run a stage to its end, on all threads if `parallel`."""
        self._counters[stage] = 0
        launches = self._launches[stage]
        if parallel and self.threads > 1:
            self._pool.run(launches)
        else:
            launches[0]()

    def set_camera(self, packed: NDArray[np.float32]) -> None:
        self._camera[:] = packed

    def reserve_gaussians(self, count: int) -> None:
        self.allocate("splats", (count, SPLAT_FLOATS), wp.float32)
        self.allocate("keys", (count,), wp.uint32)
        self.allocate("order", (count,), wp.int32)
        self.allocate("sort_scratch", (count,), wp.int32)
        self._first_slot = self.allocate("first_slot", (count + 1,), wp.int32).numpy()
        # More segments than threads even out a busy neighbour.
        self.state.segments = 2 * self.threads if count >= _SEGMENTED else 1

    def render(self) -> int:
        state = self.state
        self.reserve("tile_histogram", state.tiles * state.segments, wp.int32)
        self.reserve("tile_start", state.tiles + 1, wp.int32)
        self.run(Stage.PROJECT, state.gaussians >= _FEW)
        self.run(Stage.SORT, False)
        self.run(Stage.COUNT, state.segments > 1)
        self.run(Stage.OFFSETS, False)
        intersections = int(self._first_slot[-1])
        self.reserve("list_gaussian", intersections, wp.int32)
        self.reserve("list_slot", intersections, wp.int32)
        self.reserve("list_rows", intersections, wp.uint8)
        self.run(Stage.LIST, state.segments > 1)
        self.run(Stage.FORWARD)
        return intersections

    def loss(self) -> Callable[[], NDArray[np.float64]]:
        width, strips = self.state.width, -(-self.state.height // _STRIP_ROWS)
        if self._loss_width != width:  # the zero padding of the rows moves with the width
            self.allocate("loss_scratch", (self.threads * _loss_scratch_floats(width),), wp.float32)
            self._loss_width = width
        if len(self._partial) != strips:
            self._partial = self.allocate("loss_partial", (strips, 2), wp.float64).numpy()
        self.run(Stage.LOSS)
        sums = self._partial.sum(axis=0)
        return lambda: sums

    def observe(self) -> None:
        self.run(Stage.OBSERVE)

    def list_pairs(self) -> None:
        self.run(Stage.PAIRS)

    def contrast(self) -> None:
        self.run(Stage.CONTRAST)

    def backward(self) -> None:
        self.reserve("moments", int(self._first_slot[-1]), wp.float32, MOMENTS)
        self.run(Stage.BACKWARD)
        self.run(Stage.GATHER, self.state.gaussians >= _FEW)

    def adam(self) -> None:
        self.run(Stage.ADAM, self.state.gaussians >= _FEW)


def _loss_scratch_floats(width: int) -> int:
    """Floats that one worker needs for its rolling windows; as in loss_cpu.h."""
    stride = (3 * width + 7) // 8 * 8 + 2 * 16
    return (8 * 11 + 4 + 3 + 1) * stride
