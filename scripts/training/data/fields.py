"""Random fields over an image (1/f noise, smooth relief), and colours and images as light, bytes and CIELAB."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from ....core.color import spaces
from ....core.color.simulation import simulate_linear
from ....core.color.spaces import linear_to_srgb, linear_to_xyz, srgb_to_linear, xyz_to_lab
from ....core.files.images import to_bytes

Field = NDArray[np.float32]
Image = NDArray[np.float32]
Colors = NDArray[np.float64]

_GAMUT_BISECTIONS = 12  # chroma to 1 / 4096


def power_noise(height: int, width: int, exponent: float, generator: np.random.Generator, channels: int = 1) -> Image:
    """(H, W, channels) Gaussian noise whose amplitude falls as 1 / frequency^exponent; zero mean, unit variance.

    Natural images have an exponent near 1; 2 and more is smooth.
    """
    amplitude = _frequency(height, width) ** -exponent
    amplitude[0, 0] = 0.0
    white = generator.standard_normal((channels, height, width), dtype=np.float32)
    noise = np.fft.irfft2(np.fft.rfft2(white) * amplitude, s=(height, width))
    noise /= noise.std(axis=(1, 2), keepdims=True) + 1e-12
    return np.ascontiguousarray(noise.transpose(1, 2, 0), np.float32)


def relief(height: int, width: int, scale: float, generator: np.random.Generator) -> Field:
    """(H, W) smooth field with features of about `scale` pixels; zero mean, unit variance."""
    frequency = _frequency(height, width)
    spectrum = np.fft.rfft2(generator.standard_normal((height, width), dtype=np.float32))
    field = np.fft.irfft2(spectrum * np.exp(-0.5 * (frequency * scale * 2.0) ** 2), s=(height, width))
    field -= field.mean()
    return (field / (field.std() + 1e-12)).astype(np.float32)


def halve(image: Image) -> Image:
    """(2 H, 2 W, C) to (H, W, C) by the mean of 2 x 2 pixels."""
    return (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2]) * np.float32(0.25)


def resize(image: NDArray, height: int, width: int) -> Image:
    """Resample (H, W, C) to a size with an antialiased linear filter."""
    planes = torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)[None]
    scaled = torch.nn.functional.interpolate(planes, size=(height, width), mode="bilinear", antialias=True)
    return np.ascontiguousarray(scaled[0].permute(1, 2, 0).numpy())


@lru_cache(maxsize=8)
def _radii(height: int, width: int) -> NDArray[np.float64]:
    rows, columns = np.fft.fftfreq(height), np.fft.rfftfreq(width)
    radii = np.hypot(rows[:, None], columns[None])
    radii[0, 0] = 1.0 / max(height, width)
    return radii


def _frequency(height: int, width: int) -> NDArray[np.float64]:
    """(H, W // 2 + 1) spatial frequency in cycles a pixel; the constant's is that of the image's size."""
    return _radii(height, width).copy()


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


def simulated_lab(colors: NDArray, cvd: str) -> Colors:
    """CIELAB of (..., 3) linear colours as a dichromat of type `cvd` sees them (Machado 2009)."""
    simulated = simulate_linear(_channels_first(colors), cvd, severity=1.0)
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
