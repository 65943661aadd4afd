"""Printed cloth: dots, flowers, leaves, paisleys and rings repeated over a plain ground."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .appearance import expose, view_cloth
from .fields import Field, Image, halve, power_noise
from .palettes import Palette
from .weaves import Pixels

# Primes: each cell of the repeat gets a number of its own, without a pattern that the eye finds.
_COLUMN_STEP, _ROW_STEP, _CELLS = 7919, 104729, 4093

Motif = Callable[[Field, Field, np.random.Generator], list[Field]]
"""Local coordinates (the motif fits the unit circle) to signed fields, painted in order where positive."""


def _dot(x: Field, y: Field, generator: np.random.Generator) -> list[Field]:
    layers = [1.0 - np.hypot(x, y)]
    if generator.random() < 0.4:
        layers.append(generator.uniform(0.3, 0.7) - np.hypot(x, y))
    return layers


def _ring(x: Field, y: Field, generator: np.random.Generator) -> list[Field]:
    return [generator.uniform(0.1, 0.3) - np.abs(np.hypot(x, y) - 0.65)]


def _flower(x: Field, y: Field, generator: np.random.Generator) -> list[Field]:
    """Petals by a superformula (Gielis 2003) with three equal exponents but one, and a heart."""
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    petals, inner, outer = int(generator.integers(4, 9)), generator.uniform(0.6, 2.5), generator.uniform(0.5, 3.0)
    wave = petals * angle / 4.0
    shape = (np.abs(np.cos(wave)) ** outer + np.abs(np.sin(wave)) ** outer + 1e-6) ** (-1.0 / inner)
    layers = [shape / shape.max() - radius]
    if generator.random() < 0.6:
        layers.append(0.55 * shape / shape.max() - radius)
    layers.append(generator.uniform(0.12, 0.28) - radius)
    return layers


def _rosette(x: Field, y: Field, generator: np.random.Generator) -> list[Field]:
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    petals, depth = int(generator.integers(5, 13)), generator.uniform(0.1, 0.35)
    layers = [(1.0 - depth) + depth * np.cos(petals * angle + turn) - radius / scale
              for scale, turn in ((1.0, 0.0), (0.65, np.pi), (0.3, 0.0))]  # fmt: skip
    return layers[: int(generator.integers(2, 4))]


def _leaf(x: Field, y: Field, generator: np.random.Generator) -> list[Field]:
    width = generator.uniform(0.25, 0.5)
    bent = y - generator.uniform(-0.4, 0.4) * (1.0 - x**2)
    leaf = width * (1.0 - x**2) * (1.0 - 0.35 * x) - np.abs(bent)
    return [leaf, np.minimum(0.04 - np.abs(bent), leaf)]


def _paisley(x: Field, y: Field, generator: np.random.Generator) -> list[Field]:
    """A drop whose tip curls to one side."""
    curl = generator.uniform(0.3, 0.7)
    bent_x = x - curl * np.clip(y + 0.2, 0.0, None) ** 2
    width = 0.55 * np.sqrt(np.clip((y + 0.95) * 1.3, 0.0, None)) * np.clip(1.0 - y, 0.0, None) ** 1.2
    drop = np.where(np.abs(y) < 1.0, width - np.abs(bent_x), np.float32(-1.0))
    eye = generator.uniform(0.15, 0.25) - np.hypot(bent_x, y + 0.4)
    return [drop, drop - 0.12, eye]


MOTIFS: dict[str, Motif] = {
    "dot": _dot,
    "ring": _ring,
    "flower": _flower,
    "rosette": _rosette,
    "leaf": _leaf,
    "paisley": _paisley,
}


def draw_print(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """One to three layers of motifs on a ground."""
    view = view_cloth(height, width, generator)
    cloth = np.broadcast_to(palette.colors[0].astype(np.float32), (*view.shape, 3)).copy()
    size = float(min(height, width))
    for layer in range(generator.integers(1, 4)):
        pitch = size * float(np.exp(generator.uniform(np.log(0.05), np.log(0.45))))
        _repeat_motif(cloth, view.across, view.along, pitch, palette, 1 + 2 * layer, generator)
    if generator.random() < 0.7:
        yarns = 1.0 + generator.uniform(0.02, 0.12) * power_noise(*view.shape, 0.3, generator)
        cloth *= yarns.astype(np.float32)
    return expose(halve(cloth * view.shading[..., None]), generator)


def _repeat_motif(
    cloth: Image,
    across: Field,
    along: Field,
    pitch: float,
    palette: Palette,
    first_color: int,
    generator: np.random.Generator,
) -> None:
    """Paint a motif at every point of a half-drop lattice, each a little displaced, turned and scaled."""
    motif = MOTIFS[list(MOTIFS)[generator.integers(len(MOTIFS))]]
    u, v = across / np.float32(pitch), along / np.float32(pitch)
    column = np.floor(u).astype(np.int32)
    v = v + np.float32(generator.choice([0.0, 0.5])) * (column % 2)
    row = np.floor(v).astype(np.int32)
    cell = (column * _COLUMN_STEP + row * _ROW_STEP) % _CELLS
    disorder = generator.choice([0.0, generator.uniform(0.0, 1.0)])
    radius = np.float32(generator.uniform(0.25, 0.48))
    slack = 0.5 - radius
    x = u - column - 0.5 - (disorder * slack * generator.uniform(-1.0, 1.0, _CELLS)).astype(np.float32)[cell]
    y = v - row - 0.5 - (disorder * slack * generator.uniform(-1.0, 1.0, _CELLS)).astype(np.float32)[cell]
    turn = (generator.uniform(0.0, 6.28) + disorder * generator.uniform(-3.14, 3.14, _CELLS)).astype(np.float32)[cell]
    size = radius * (1.0 - 0.4 * disorder * generator.random(_CELLS)).astype(np.float32)[cell]
    x, y = (np.cos(turn) * x + np.sin(turn) * y) / size, (np.cos(turn) * y - np.sin(turn) * x) / size
    variants = generator.integers(0, 2, _CELLS)[cell] if generator.random() < 0.4 else np.zeros_like(cell)
    for part, field in enumerate(motif(x, y, generator)):
        colors = palette.colors[(first_color + part + 3 * np.arange(2)) % len(palette.colors)].astype(np.float32)
        inside = field > 0.0
        cloth[inside] = colors[variants[inside]]
