"""The parameters of N Gaussians on a device, and arrays of the same shapes for gradients and optimiser moments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...files.states import SavedState
from ..gaussians import Gaussians

FIELDS = ("means", "log_scales", "quaternions", "opacity_logits", "sh")


def _shapes(count: int, sh_count: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, sh_count, 3))
    return zip(FIELDS, shapes, strict=True)


@dataclass(frozen=True, eq=False)
class ParameterSet:
    """N Gaussians as float32 arrays on one device, parametrised as `Gaussians`.

    Attributes:
        means: (N, 3) wp.array.
        log_scales: (N, 3) wp.array.
        quaternions: (N, 4) wp.array, wxyz.
        opacity_logits: (N,) wp.array.
        sh: (N, K, 3) wp.array, K in {1, 4, 9, 16}.
    """

    means: wp.array
    log_scales: wp.array
    quaternions: wp.array
    opacity_logits: wp.array
    sh: wp.array

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def device(self) -> wp.Device:
        return self.means.device

    @property
    def sh_count(self) -> int:
        """K, the number of spherical harmonics coefficients per colour channel."""
        return self.sh.shape[1]

    @classmethod
    def from_gaussians(cls, gaussians: Gaussians, device: str = "cpu") -> ParameterSet:
        """Copy `gaussians` to `device`."""
        if gaussians.sh.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"sh has {gaussians.sh.shape[1]} coefficients per channel, not 1, 4, 9 or 16")
        copies = (np.array(getattr(gaussians, name), np.float32, order="C") for name in FIELDS)
        return cls(*(wp.array(copy, dtype=wp.float32, device=device) for copy in copies))

    @classmethod
    def zeros(cls, count: int, sh_count: int, device: str | wp.Device = "cpu") -> Self:
        """`count` Gaussians of zeros, for gradients and optimiser moments."""
        return cls(
            **{name: wp.zeros(shape, dtype=wp.float32, device=device) for name, shape in _shapes(count, sh_count)}
        )

    @classmethod
    def restored(cls, saved: SavedState, count: int, sh_count: int, device: str | wp.Device) -> Self:
        """The arrays of `numpy` out of a file; raises `InputError` where they are not of `count` Gaussians."""
        arrays = {name: saved.array(name, np.float32, *shape) for name, shape in _shapes(count, sh_count)}
        return cls(**{name: wp.array(array, dtype=wp.float32, device=device) for name, array in arrays.items()})

    def with_opacity_logits(self, logits: NDArray[np.float32]) -> Self:
        """The same Gaussians with other opacities, (N,); all other arrays are shared."""
        return replace(self, opacity_logits=wp.array(logits, dtype=wp.float32, device=self.device))

    def numpy(self) -> dict[str, NDArray[np.float32]]:
        """The arrays by field name: views of this memory on the CPU, copies on CUDA."""
        return {name: getattr(self, name).numpy() for name in FIELDS}

    def to_gaussians(self) -> Gaussians:
        """A copy as plain arrays."""
        return Gaussians(**{name: value.copy() for name, value in self.numpy().items()})


@dataclass(frozen=True, eq=False)
class Gradients(ParameterSet):
    """dL/dparameter for every field of `ParameterSet`; zero for Gaussians that were not drawn.

    Attributes:
        screen: (N,) wp.array, norm of dL/d(screen-space mean) in the units of 3DGS, whose densification thresholds are
            stated in them: per pixel, times (W / 2, H / 2).
        screen_abs: (N,) wp.array, the same from sums of absolute values over the pixels (Ye et al. 2024, AbsGS);
            zero unless `backward` was called with `absolute`.
        touched: (N,) uint8 wp.array, 1 where the Gaussian was drawn and its gradient is finite: those that Adam moves.
        colors_only: whether only `sh[:, 0]` was computed; the other arrays are then meaningless.
    """

    screen: wp.array
    screen_abs: wp.array
    touched: wp.array
    colors_only: bool = False

    @classmethod
    def zeros(cls, count: int, sh_count: int, device: str | wp.Device = "cpu") -> Self:
        """Gradients of zero, for `count` Gaussians of which none was drawn."""
        arrays = {name: wp.zeros(shape, dtype=wp.float32, device=device) for name, shape in _shapes(count, sh_count)}
        per_gaussian = {name: wp.zeros(count, dtype=wp.float32, device=device) for name in ("screen", "screen_abs")}
        return cls(**arrays, **per_gaussian, touched=wp.zeros(count, dtype=wp.uint8, device=device))
