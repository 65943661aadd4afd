"""Synthetic test images: a tartan and a plate whose two colours a deutan cannot tell apart."""

from __future__ import annotations

import numpy as np
import torch

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.core.color.spaces import linear_to_srgb


def confused_colors(cvd: str, model: str = "machado", base: tuple[float, float, float] = (0.16, 0.14, 0.12)):
    """Two linear colours on one confusion line: the direction that the dichromat's matrix loses, about `base`."""
    lost = np.linalg.svd(linear_simulation(cvd, 1.0, model).matrix)[2][-1]
    reach = 0.8 * np.min(np.array(base) / np.maximum(np.abs(lost), 1e-9))
    return np.array(base) + reach * lost, np.array(base) - reach * lost


def to_bytes(linear: np.ndarray) -> np.ndarray:
    """(H, W, 3) linear light to sRGB bytes."""
    encoded = linear_to_srgb(torch.from_numpy(np.moveaxis(linear, -1, 0)).clamp(0, 1))
    return np.ascontiguousarray((encoded.movedim(0, -1).numpy() * 255).round().astype(np.uint8))


def tartan(cvd: str = "deutan", size: int = 128, stripe: int = 16, shift: int = 0, seed: int = 0) -> np.ndarray:
    """(size, size, 3) uint8 twill of two confused colours under a soft, uneven light."""
    first, second = confused_colors(cvd)
    rows, columns = np.mgrid[:size, :size]
    in_warp, in_weft = (columns + shift) // stripe % 2 == 0, (rows + shift) // stripe % 2 == 0
    picked = np.where((rows // 2 + columns // 2) % 4 < 2, in_warp, in_weft)
    light = 0.9 + 0.25 * np.sin(rows / size * 4 + shift / 9) * np.cos(columns / size * 3)
    noise = np.random.default_rng(seed).normal(1.0, 0.03, (size, size))
    return to_bytes(np.where(picked[..., None], first, second) * (light * noise)[..., None])


def plate(cvd: str = "deutan", size: int = 192, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Dots in the manner of Ishihara, (size, size, 3) uint8, and labels: 0 gap, 1 ground, 2 figure (a cross)."""
    generator = np.random.default_rng(seed)
    figure, ground = confused_colors(cvd)
    image, labels = np.full((size, size, 3), 0.8), np.zeros((size, size), int)
    rows, columns = np.mgrid[:size, :size]
    for _ in range(1200):
        x, y, radius = *generator.uniform(0, size, 2), generator.uniform(3, 7)
        dot = (columns - x) ** 2 + (rows - y) ** 2 < radius**2
        if (labels[dot] > 0).any():
            continue
        near, far = sorted((abs(x - size / 2), abs(y - size / 2)))
        in_figure = near < 0.09 * size and far < 0.33 * size
        image[dot] = (figure if in_figure else ground) * generator.uniform(
            0.8, 1.25
        )  # luminance jitter hides nothing else
        labels[dot] = 2 if in_figure else 1
    return to_bytes(image), labels
