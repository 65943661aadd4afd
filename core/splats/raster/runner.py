"""Runs the kernels of a device: the state they share, the arrays bound to it, and buffers that grow."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...errors import InputError
from ...runtime.progress import COMPILING
from ...runtime.protocol import Reporter
from .state import State

SPLAT_FLOATS, MOMENTS = 16, 12  # as in numeric.h
TILE_WIDTH, TILE_HEIGHT = 8, 16  # pixels; as in numeric.h
_GROWTH = 1.3  # headroom when a buffer has to grow


class Runner(ABC):
    """One `State` and the arrays bound to it. The abstract methods are the stages of a step, implemented per device."""

    def __init__(self, device: wp.Device) -> None:
        self.device = device
        self.state = State()
        self._bound: dict[str, wp.array] = {}

    def array(self, name: str) -> wp.array:
        """The array bound to a field of the state."""
        return self._bound[name]

    def bind(self, name: str, array: wp.array) -> None:
        """Put an array into the state and keep it alive; costs nothing if it is there already."""
        if self._bound.get(name) is not array:
            setattr(self.state, name, array)
            self._bound[name] = array

    def allocate(self, name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """Bind a new array of zeros."""
        array = wp.zeros(shape, dtype=dtype, device=self.device)
        self.bind(name, array)
        return array

    def reserve(self, name: str, count: int, dtype: type, width: int = 0) -> None:
        """Make room for `count` elements (rows of `width`, if given); growing loses the contents."""
        bound = self._bound.get(name)
        if bound is None or bound.shape[0] < count:
            capacity = int(count * _GROWTH) + 1024
            self.bind(name, wp.empty((capacity, width) if width else capacity, dtype=dtype, device=self.device))

    @abstractmethod
    def set_camera(self, packed: NDArray[np.float32]) -> None:
        """Copy `RasterCamera.packed` to the device."""

    @abstractmethod
    def reserve_gaussians(self, count: int) -> None:
        """Make room for the per-Gaussian arrays; called when the number of Gaussians changes."""

    @abstractmethod
    def render(self) -> int:
        """Project, sort, bin and blend; returns the number of intersections of Gaussians with tiles."""

    @abstractmethod
    def loss(self) -> Callable[[], NDArray[np.float64]]:
        """Fill `grad_color`; returns a function that waits for the sums of |x - y| and SSIM over the image."""

    @abstractmethod
    def observe(self) -> None:
        """Fill `contrast_lab`."""

    @abstractmethod
    def list_pairs(self) -> None:
        """Fill `contrast_pairs` from the target's part of `contrast_lab`."""

    @abstractmethod
    def contrast(self) -> None:
        """Add the contrast hinge's gradient to `grad_color`."""

    @abstractmethod
    def backward(self) -> None:
        """Turn gradients of the images into gradients of the parameters."""

    @abstractmethod
    def adam(self) -> None:
        """One step of the optimiser."""


def resolve_device(name: str | wp.Device) -> wp.Device:
    """The Warp device of a name such as "cpu", "cuda" or "cuda:1".

    Raises:
        InputError: there is no such device.
    """
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        if name == "cpu":  # which every machine has: something else is wrong
            raise
        raise InputError(f"there is no device {name!r} here", remedy='use "cpu"') from error


# The functions below import kernels when called: Warp would register and hash those of the other device for nothing.


def make_runner(device: wp.Device, threads: int | None) -> Runner:
    """The runner for a device; `threads` counts on the CPU only."""
    if device.is_cuda:
        from .runner_cuda import CudaRunner

        return CudaRunner(device)
    from .runner_cpu import CpuRunner

    return CpuRunner(device, threads)


def load(device: str = "cpu", reporter: Reporter | None = None) -> None:
    """Compile the kernels for a device, or load them from Warp's cache (`WARP_CACHE_PATH`). Needed once per process.

    Compiling takes seconds, the cache milliseconds; the first render would do the same, but silently. Warp names
    cached objects after the processor's features, so machines may share a cache.

    Raises:
        InputError: there is no such device.
    """
    resolved = resolve_device(device)
    (reporter or Reporter()).status(COMPILING, f"preparing the kernels for {resolved}; the first run compiles them")
    if resolved.is_cuda:
        from . import kernels_cuda

        for block_dim in (kernels_cuda.BLEND_THREADS, kernels_cuda.LOSS_THREADS):
            wp.load_module(kernels_cuda, device=resolved, block_dim=block_dim)
    else:
        from . import kernels_cpu

        wp.load_module(kernels_cpu, device=resolved)
