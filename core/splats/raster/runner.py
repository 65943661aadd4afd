"""Runs the stages of a device: keeps the kernels' state, binds arrays to it and launches."""

from __future__ import annotations

import os

import warp as wp

from ...events import Reporter
from . import kernels_cpu
from .kernels_cpu import Stage
from .state import State
from .workers import WorkerPool

wp.config.quiet = True  # its banner would end up among the events on stdout

_GROWTH = 1.3  # head room when a buffer has to grow


class Runner:
    """One `State`, the arrays in it, and the launches prepared on it.

    A launch keeps the state by reference, so that changing a field is all that the next launch needs: wrapping the
    arguments anew would cost more than some of the kernels.
    """

    def __init__(self, device: str, threads: int | None) -> None:
        self.device = wp.get_device(device)
        self.threads = threads or len(os.sched_getaffinity(0))
        self.state = State()
        self._bound: dict[str, wp.array] = {}
        self._pool = WorkerPool(self.threads)
        self._counters = self.allocate("counters", (len(Stage),), wp.int32).numpy()
        self._launches = {
            stage: [
                wp.launch(kernel, 1, inputs=[self.state, worker], device=self.device, record_cmd=True).launch
                for worker in range(self.threads)
            ]
            for stage, kernel in kernels_cpu.KERNELS.items()
        }

    def run(self, stage: Stage, parallel: bool = True) -> None:
        """Runs a stage to its end, on all threads where it is worth waking them."""
        self._counters[stage] = 0
        launches = self._launches[stage]
        if parallel and self.threads > 1:
            self._pool.run(launches)
        else:
            launches[0]()

    def array(self, name: str) -> wp.array:
        """What is bound to a field of the state."""
        return self._bound[name]

    def bind(self, name: str, array: wp.array) -> None:
        """Puts an array into the state and keeps it alive; free where it is there already."""
        if self._bound.get(name) is not array:
            setattr(self.state, name, array)
            self._bound[name] = array

    def allocate(self, name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """A zeroed array of this shape: the bound one where it fits exactly and need not be cleared, else a new one."""
        array = wp.zeros(shape, dtype=dtype, device=self.device)
        self.bind(name, array)
        return array

    def reserve(self, name: str, count: int, dtype: type, width: int = 0) -> None:
        """Makes room for `count` elements (rows of `width`, if given); the contents are lost when it has to grow."""
        bound = self._bound.get(name)
        if bound is None or bound.shape[0] < count:
            capacity = int(count * _GROWTH) + 1024
            self.bind(name, wp.empty((capacity, width) if width else capacity, dtype=dtype, device=self.device))


def load(device: str = "cpu", reporter: Reporter | None = None) -> None:
    """Compiles the kernels for a device, or loads them from Warp's cache (`WARP_CACHE_PATH`). Needed once a process.

    Compiling takes a few seconds, the cache milliseconds; a launch would do the same, but silently.
    """
    (reporter or Reporter()).status("kernels", f"preparing the kernels for {device}; the first run compiles them")
    wp.load_module(kernels_cpu, device=device)
