"""How things look in a photograph: viewing geometry, folds, light, lens, sensor and lossy storage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from .fields import Field, Image, encode, relief

_BLOCK = 16  # pixels of a JPEG coding unit with 4:2:0 chroma


@dataclass(frozen=True)
class ClothView:
    """A cloth as the camera sees it, (H, W) each.

    Attributes:
        across, along: position on the cloth, in pixels of an image without distortion.
        shading: light that the cloth's slope receives, about 1.
    """

    across: Field
    along: Field
    shading: Field

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.across.shape[0], self.across.shape[1]


def view_cloth(height: int, width: int, generator: np.random.Generator, oversampling: int = 2) -> ClothView:
    """Rotate, tilt and fold a cloth; arrays of `oversampling` times the image's size."""
    rows, columns = np.mgrid[: height * oversampling, : width * oversampling].astype(np.float32)
    x, y = columns / oversampling - width / 2.0, rows / oversampling - height / 2.0
    size = float(max(height, width))
    tilt = generator.normal(0.0, 0.25, 2).clip(-0.5, 0.5) * (generator.random() < 0.6)
    depth = 1.0 + (tilt[0] * x + tilt[1] * y) / size
    angle = generator.choice([0.0, np.pi / 4.0, generator.uniform(-np.pi, np.pi)], p=[0.4, 0.1, 0.5])
    angle = angle + generator.normal(0.0, 0.05)
    cosine, sine = np.cos(angle), np.sin(angle)
    across, along = (cosine * x - sine * y) / depth, (sine * x + cosine * y) / depth
    shading = np.ones_like(x)
    if generator.random() < 0.65:
        across, along, shading = _fold(across, along, height, width, oversampling, generator)
    across += generator.uniform(0.0, 4096.0)
    along += generator.uniform(0.0, 4096.0)
    return ClothView(across.astype(np.float32), along.astype(np.float32), shading.astype(np.float32))


def _fold(
    across: Field, along: Field, height: int, width: int, oversampling: int, generator: np.random.Generator
) -> tuple[Field, Field, Field]:
    """Soft folds: the slope of a relief displaces the pattern and takes light."""
    shape = (height * oversampling, width * oversampling)
    scale = oversampling * max(height, width) * generator.uniform(0.1, 0.6)
    slope_y, slope_x = (slope / (slope.std() + 1e-12) for slope in np.gradient(relief(*shape, scale, generator)))
    depth = generator.uniform(0.1, 1.0)
    # A tenth of the folds' size at most: more would turn the cloth into a liquid.
    bend = 0.1 * depth * generator.random() * scale / oversampling
    light = generator.uniform(0.0, 2.0 * np.pi)
    facing = np.cos(light) * slope_x + np.sin(light) * slope_y
    strength = depth * generator.uniform(0.05, 0.3)
    shading = np.exp(np.clip(strength * facing, -1.6, 0.7))
    return across + bend * slope_x, along + bend * slope_y, shading


def expose(scene: Image, generator: np.random.Generator) -> NDArray[np.uint8]:
    """(H, W, 3) linear reflectances or light to the bytes of a photograph of them."""
    height, width = scene.shape[:2]
    image = scene * _lamp(generator) * _uneven_light(height, width, generator)[..., None]
    image = image * np.float32(generator.lognormal(0.0, 0.18))
    if generator.random() < 0.5:
        sigma = generator.uniform(0.3, 1.1)
        image = gaussian_filter(image, (sigma, sigma, 0.0), truncate=3.0)
    if generator.random() < 0.6:
        image = _add_sensor_noise(image, generator)
    pixels = encode(image)
    if generator.random() < 0.35:
        pixels = _lose(pixels, generator.uniform(55.0, 92.0))
    return pixels


def _lamp(generator: np.random.Generator) -> NDArray[np.float32]:
    """(3,) gains of a mild colour cast: mostly warm to cool, a little green to magenta; unit luminance, about."""
    warmth, tint = generator.normal(0.0, 0.06), generator.normal(0.0, 0.02)
    return np.exp(np.array([warmth, tint, -warmth])).astype(np.float32)


def _uneven_light(height: int, width: int, generator: np.random.Generator) -> Field:
    """(H, W) vignetting and the fall-off of a near lamp."""
    y = np.linspace(-1.0, 1.0, height, dtype=np.float32)[:, None]
    x = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None]
    falloff = np.ones((height, width), np.float32)
    if generator.random() < 0.6:
        falloff /= (1.0 + generator.uniform(0.0, 0.15) * (x**2 + y**2)) ** 2
    if generator.random() < 0.5:
        dx, dy = generator.normal(0.0, 0.2, 2)
        falloff *= np.exp(dx * x + dy * y)
    return falloff.astype(np.float32)


def _add_sensor_noise(image: Image, generator: np.random.Generator) -> Image:
    """Photon noise, which grows with the root of the light, and read noise."""
    photon, read = generator.uniform(0.0, 0.02), generator.uniform(0.0, 0.004)
    noise = generator.standard_normal(image.shape, dtype=np.float32)
    return image + noise * np.sqrt(photon**2 * np.clip(image, 0.0, None) + read**2).astype(np.float32)


def _lose(pixels: NDArray[np.uint8], quality: float) -> NDArray[np.uint8]:
    """What JPEG at this quality leaves of an image."""
    from kornia.enhance import jpeg_codec_differentiable  # late: kornia takes a second to import

    height, width = pixels.shape[:2]
    padding = ((0, -height % _BLOCK), (0, -width % _BLOCK), (0, 0))
    padded = torch.from_numpy(np.pad(pixels, padding, mode="edge")).permute(2, 0, 1)[None].float() / 255.0
    with torch.no_grad():
        coded = jpeg_codec_differentiable(padded, torch.tensor([quality]))
    return np.ascontiguousarray((coded[0, :, :height, :width].permute(1, 2, 0) * 255.0).round().clamp(0, 255).byte())
