"""Keeps what a device's kernels work on: the state, the arrays in it, work space that grows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .state import State

SPLAT_FLOATS, MOMENTS = 16, 12  # as in numeric.h
TILE_WIDTH, TILE_HEIGHT = 8, 16  # pixels; as in numeric.h
_GROWTH = 1.3  # head room when a buffer has to grow


class Runner(ABC):
    """One `State` and the arrays bound to it. The stages of a step, device by device, are the abstract methods."""

    def __init__(self, device: wp.Device) -> None:
        self.device = device
        self.state = State()
        self._bound: dict[str, wp.array] = {}

    def array(self, name: str) -> wp.array:
        """What is bound to a field of the state."""
        return self._bound[name]

    def bind(self, name: str, array: wp.array) -> None:
        """Puts an array into the state and keeps it alive; free where it is there already."""
        if self._bound.get(name) is not array:
            setattr(self.state, name, array)
            self._bound[name] = array

    def allocate(self, name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """Binds a new array of zeros."""
        array = wp.zeros(shape, dtype=dtype, device=self.device)
        self.bind(name, array)
        return array

    def reserve(self, name: str, count: int, dtype: type, width: int = 0) -> None:
        """Makes room for `count` elements (rows of `width`, if given); the contents are lost when it has to grow."""
        bound = self._bound.get(name)
        if bound is None or bound.shape[0] < count:
            capacity = int(count * _GROWTH) + 1024
            self.bind(name, wp.empty((capacity, width) if width else capacity, dtype=dtype, device=self.device))

    @abstractmethod
    def set_camera(self, packed: NDArray[np.float32]) -> None:
        """Hands over `RasterCamera.packed`."""

    @abstractmethod
    def reserve_gaussians(self, count: int) -> None:
        """Makes room for what is kept per Gaussian; called when their number changes."""

    @abstractmethod
    def render(self) -> int:
        """Projects, sorts, bins and blends; returns the number of intersections of Gaussians with tiles."""

    @abstractmethod
    def loss(self) -> Callable[[], NDArray[np.float64]]:
        """Fills `grad_color`; returns what gives the sums of |x - y| and of SSIM over the image, waiting if it must."""

    @abstractmethod
    def backward(self) -> None:
        """Gradients of the images to gradients of the parameters."""

    @abstractmethod
    def adam(self) -> None:
        """One step of the optimiser."""
