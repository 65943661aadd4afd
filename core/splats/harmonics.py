"""Spherical harmonics of view-dependent colours: their values, and those of a scene that was turned. numpy only.

Real harmonics with the Condon-Shortley phase, in the order and with the signs of the standard 3DGS PLY.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .gaussians import SH_C0

SH_C1 = 0.4886025119029199
SH_C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
SH_C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)
_DIRECTIONS = 64  # on which a turned function is fitted; it has at most 16 coefficients


def basis(directions: NDArray[np.floating], degree: int) -> NDArray[np.float64]:
    """(N, (degree + 1)^2) values of the functions up to `degree`, 0 to 3, in the (N, 3) unit `directions`."""
    x, y, z = directions.astype(np.float64).T
    xx, yy, zz = x * x, y * y, z * z
    columns = [np.full_like(x, SH_C0), -SH_C1 * y, SH_C1 * z, -SH_C1 * x]
    columns += [
        weight * value for weight, value in zip(SH_C2, (x * y, y * z, 2 * zz - xx - yy, x * z, xx - yy), strict=True)
    ]
    thirds = (
        y * (3 * xx - yy),
        x * y * z,
        y * (4 * zz - xx - yy),
        z * (2 * zz - 3 * xx - 3 * yy),
        x * (4 * zz - xx - yy),
        z * (xx - yy),
        x * (xx - 3 * yy),
    )
    columns += [weight * value for weight, value in zip(SH_C3, thirds, strict=True)]
    return np.stack(columns[: (degree + 1) ** 2], axis=1)


def turned(sh: NDArray[np.floating], rotation: NDArray[np.floating]) -> NDArray[np.float32]:
    """(N, K, 3) coefficients of the colours of (N, K, 3) `sh` after everything was turned by `rotation`, (3, 3).

    A turned function has no other degrees, so its coefficients are fitted exactly, on directions all around.
    """
    degree = round(sh.shape[1] ** 0.5) - 1
    if degree == 0:
        return sh.astype(np.float32)
    # A spiral from pole to pole is as good as any even spread.
    height = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
    angle = np.pi * (3.0 - 5.0**0.5) * np.arange(_DIRECTIONS)
    radius = np.sqrt(1.0 - height**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    matrix = np.linalg.pinv(basis(directions, degree)) @ basis(directions @ rotation, degree)
    return np.einsum("jk,nkc->njc", matrix, sh).astype(np.float32)
