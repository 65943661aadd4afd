"""Random scalar fields over an image: 1/f noise, smooth relief, and resampling of what was drawn larger."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from .light import Image

Field = NDArray[np.float32]


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
