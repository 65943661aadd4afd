"""The Gaussians of a scene as plain arrays. numpy only: Blender's Python imports this."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

SH_C0 = 0.28209479177387814  # Y_0^0 = 1 / (2 sqrt(pi))
LOW_PASS = 0.3
"""Square pixels that the rasteriser adds to the variance of every projection, as Kerbl et al. 2023 and viewers do."""
# Largest size of Gaussians read from a file: 76 million of SH degree 0, or 18 million of degree 3.
MOST_BYTES = 4 << 30
# Largest size of such a file. Double precision and normals make a PLY larger than its Gaussians.
MOST_FILE_BYTES = 3 * MOST_BYTES
HIGHEST_SH_DEGREE = 3
SH_TERMS = (0, 3, 8, 15, 24)  # per channel above degree 0, by SH degree; files may have one degree more than ours
_LARGEST_LOG_AREA = np.float32(88.0)  # whose exponential is a float32
_BASE_NUMBERS = 14  # per Gaussian of SH degree 0
# The radius of a scene is taken inside this part of the Gaussians: a few always float far away.
_CORE_PERCENTILES = (5.0, 95.0)


@dataclass(frozen=True)
class Gaussians:
    """N anisotropic Gaussians, parametrised as in the standard 3DGS PLY.

    Attributes:
        means: (N, 3) float32, world positions.
        log_scales: (N, 3) float32, natural logarithm of the standard deviations along the local axes.
        quaternions: (N, 4) float32, wxyz, local to world; not necessarily of unit length.
        opacity_logits: (N,) float32; opacity = sigmoid(logit).
        sh: (N, K, 3) float32, spherical harmonics coefficients per colour channel, K = (degree + 1)^2 in {1, 4, 9, 16};
            colour = max(0, 0.5 + sum_k sh_k Y_k(direction)), display-referred sRGB.
    """

    means: NDArray[np.float32]
    log_scales: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    opacity_logits: NDArray[np.float32]
    sh: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """0 to 3."""
        return round(self.sh.shape[1] ** 0.5) - 1

    @property
    def base_colors(self) -> NDArray[np.float32]:
        """(N, 3) colour of the degree-0 term, display-referred sRGB, not clipped above."""
        return np.maximum(0.5 + SH_C0 * self.sh[:, 0], 0.0)

    @property
    def opacities(self) -> NDArray[np.float32]:
        """(N,) from 0 to 1."""
        with np.errstate(over="ignore"):  # a logit that is far enough below 0 means an opacity of 0
            return (1.0 / (1.0 + np.exp(-self.opacity_logits.astype(np.float64)))).astype(np.float32)

    @property
    def importance(self) -> NDArray[np.float32]:
        """(N,) what each contributes to pictures: its opacity times the area of its two longest axes.

        Areas that single precision cannot hold count as the same.
        """
        with np.errstate(over="ignore"):
            log_area = self.log_scales.sum(axis=1) - self.log_scales.min(axis=1)
        return self.opacities * np.exp(np.minimum(log_area, _LARGEST_LOG_AREA))

    @classmethod
    def none(cls) -> Gaussians:
        """No Gaussians, of SH degree 0."""
        return cls(*(np.zeros((0, *shape), np.float32) for shape in ((3,), (3,), (4,), (), (1, 3))))

    def take(self, index: NDArray[np.integer] | NDArray[np.bool_]) -> Gaussians:
        """Copies of the Gaussians at (M,) indices, or of those selected by an (N,) mask."""
        return Gaussians(**{name: values[index] for name, values in vars(self).items()})

    def with_base_colors(self, colors: NDArray[np.float32]) -> Gaussians:
        """The same geometry with (N, 3) sRGB colours, independent of the direction."""
        sh = ((np.asarray(colors, np.float32) - 0.5) / SH_C0)[:, None, :]
        return replace(self, sh=np.ascontiguousarray(sh))

    def with_sh_degree(self, degree: int) -> Gaussians:
        """The same colours with room for the terms up to `degree`."""
        sh = np.zeros((len(self), (degree + 1) ** 2, 3), np.float32)
        sh[:, : self.sh.shape[1]] = self.sh
        return replace(self, sh=sh)


def core_bounds(positions: NDArray[np.float32]) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and radius of the part of the scene that holds most of the (N, 3) positions, floaters left out."""
    low, high = np.percentile(positions.astype(np.float64), _CORE_PERCENTILES, axis=0)
    return (low + high) / 2.0, max(float(np.linalg.norm(high - low)) / 2.0, float(np.finfo(np.float32).eps))


def require_room(count: int, rest: int, where: Path) -> None:
    """Raise `InputError` where `count` Gaussians with `rest` colour terms above degree 0 exceed `MOST_BYTES`.

    Called before anything is allocated: a small compressed file can claim any number.
    """
    most = MOST_BYTES // (4 * (_BASE_NUMBERS + 3 * rest))
    if count > most:
        raise InputError(
            f"it claims {count:,} Gaussians, and {most:,} of this kind is the limit",
            where=where,
            remedy="crop or thin out the scene in a splat editor",
        )
