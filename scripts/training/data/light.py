"""Conversions of colour lists and images between linear light, bytes and CIELAB, in numpy; for drawn images."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from ....core.color import spaces
from ....core.color.simulation import simulate_linear
from ....core.color.spaces import linear_to_srgb, linear_to_xyz, srgb_to_linear, xyz_to_lab
from ....core.files.images import to_bytes

Colors = NDArray[np.float64]
Image = NDArray[np.float32]

_GAMUT_BISECTIONS = 12  # chroma to 1 / 4096


def encode(linear: NDArray) -> NDArray[np.uint8]:
    """Linear sRGB of any shape, clipped, to display-referred bytes."""
    clipped = torch.from_numpy(np.ascontiguousarray(linear, np.float32)).clamp(0.0, 1.0)
    return to_bytes(linear_to_srgb(clipped).numpy())


def decode(image: NDArray[np.uint8]) -> Image:
    """Display-referred bytes of any shape to linear sRGB."""
    return srgb_to_linear(torch.from_numpy(image.astype(np.float32) / np.float32(255.0))).numpy()


def linear_to_lab(colors: NDArray) -> Colors:
    """(..., 3) linear sRGB to CIELAB under D65."""
    return _channels_last(xyz_to_lab(linear_to_xyz(_channels_first(colors))), colors.shape)


def simulated_lab(colors: NDArray, cvd: str, severity: float = 1.0, model: str = "machado") -> Colors:
    """CIELAB of (..., 3) linear colours as the observer sees them."""
    simulated = simulate_linear(_channels_first(colors), cvd, severity, model)
    return _channels_last(xyz_to_lab(linear_to_xyz(simulated)), colors.shape)


def lab_to_linear(lab: NDArray) -> Colors:
    """(..., 3) CIELAB under D65 to linear sRGB, which may lie outside [0, 1]."""
    return _channels_last(spaces.lab_to_linear(_channels_first(np.asarray(lab))), np.shape(lab))


def lch_to_linear(lightness: NDArray, chroma: NDArray, hue: NDArray) -> Colors:
    """(N, 3) linear sRGB of CIELAB lightness, chroma and hue in radians; chroma is reduced to what the gamut holds."""

    def linear(scale: NDArray) -> Colors:
        lab = np.stack([lightness, scale * chroma * np.cos(hue), scale * chroma * np.sin(hue)], -1)
        return lab_to_linear(lab)

    low, high = np.zeros(np.shape(hue)), np.ones(np.shape(hue))
    fits = _in_gamut(linear(high))
    for _ in range(_GAMUT_BISECTIONS):
        middle = (low + high) / 2.0
        inside = _in_gamut(linear(middle))
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.clip(linear(np.where(fits, 1.0, low)), 0.0, 1.0)


def _in_gamut(linear: Colors) -> NDArray[np.bool_]:
    return ((linear >= 0.0) & (linear <= 1.0)).all(-1)


def _channels_first(colors: NDArray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(colors.reshape(-1, 3).T, np.float64))[..., None]


def _channels_last(planes: torch.Tensor, shape: tuple[int, ...]) -> Colors:
    return np.ascontiguousarray(planes[..., 0].numpy().T).reshape(shape)
