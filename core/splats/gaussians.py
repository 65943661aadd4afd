"""The Gaussians of a scene as plain arrays. numpy only: Blender's Python imports this."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

SH_C0 = 0.28209479177387814  # Y_0^0 = 1 / (2 sqrt(pi))


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
        """(N,) in (0, 1)."""
        return (1.0 / (1.0 + np.exp(-self.opacity_logits.astype(np.float64)))).astype(np.float32)

    def with_base_colors(self, colors: NDArray[np.float32]) -> Gaussians:
        """The same geometry with (N, 3) sRGB colours that do not depend on the direction."""
        sh = ((np.asarray(colors, np.float32) - 0.5) / SH_C0)[:, None, :]
        return replace(self, sh=np.ascontiguousarray(sh))
