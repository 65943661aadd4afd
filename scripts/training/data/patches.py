"""Abstract images with the statistics of natural ones: colour boards, cells, dead leaves and coloured 1/f noise.

Dead leaves (shapes of power-law sizes that hide each other) have the edges, scales and occlusions of photographs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .appearance import expose
from .fields import Colors, Field, Image, lab_to_linear, linear_to_lab, power_noise, relief
from .palettes import Palette

Pixels = NDArray[np.uint8]


def draw_board(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Flat swatches side by side, with or without a margin: a palette, a chart, a legend."""
    rows, columns = generator.integers(1, 9, 2)
    y = np.linspace(0.0, rows, height, endpoint=False)[:, None]
    x = np.linspace(0.0, columns, width, endpoint=False)[None]
    count = int(generator.integers(2, len(palette.colors) + 1))
    swatches = palette.colors[generator.integers(0, count, (rows, columns))]
    board = swatches[y.astype(int), x.astype(int)]
    margin = generator.choice([0.0, generator.uniform(0.02, 0.2)])
    in_margin = np.minimum(np.minimum(y % 1.0, 1.0 - y % 1.0), np.minimum(x % 1.0, 1.0 - x % 1.0)) < margin
    board[in_margin] = generator.choice([0.02, 0.2, 0.9])
    if generator.random() < 0.3:
        board = board * (0.6 + 0.4 * x[..., None] / columns)
    return expose(board.astype(np.float32), generator)


def draw_cells(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Voronoi cells, some with joints, some softly shaded: mosaics, maps, pebbles."""
    count = int(np.exp(generator.uniform(np.log(8), np.log(600))))
    points = generator.random((count, 2)) * [height, width]
    rows, columns = np.mgrid[:height, :width] + 0.5
    distance, cell = cKDTree(points).query(np.stack([rows.ravel(), columns.ravel()], -1), k=2)
    colors = _vary(
        palette.colors[generator.integers(0, len(palette.colors), count)], generator.uniform(0, 6), generator
    )
    image = colors[cell[:, 0]]
    if generator.random() < 0.4:
        joint = distance[:, 1] - distance[:, 0] < generator.uniform(1.0, 3.0)
        image[joint] = generator.choice([0.02, 0.15, 0.8])
    if generator.random() < 0.5:
        spacing = np.sqrt(height * width / count)
        image = image * np.exp(-generator.uniform(0.0, 0.8) * (distance[:, :1] / spacing) ** 2)
    return expose(image.reshape(height, width, 3).astype(np.float32), generator)


def draw_noise(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """1/f noise between the palette's colours, or about their mean with natural correlation of the channels."""
    exponent = generator.uniform(0.7, 1.9)
    if generator.random() < 0.5:
        fields = power_noise(height, width, exponent, generator, 5) * generator.uniform(1.0, 3.0)
        weights = np.exp(fields - fields.max(-1, keepdims=True))
        weights /= weights.sum(-1, keepdims=True)
        return expose((weights @ palette.colors[:5].astype(np.float32)).astype(np.float32), generator)
    # Ruderman, Cronin and Chiao 1998: lightness varies most, blue-yellow less, red-green least.
    deviations = np.array([1.0, generator.uniform(0.1, 0.8), generator.uniform(0.1, 0.8)]) * generator.uniform(
        6.0, 25.0
    )
    lab = linear_to_lab(palette.colors[0]) + power_noise(height, width, exponent, generator, 3) * deviations
    return expose(np.clip(lab_to_linear(lab), 0.0, 1.0).astype(np.float32), generator)


def draw_leaves(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Textured and shaded dead leaves in the palette's colours."""
    return expose(dead_leaves(height, width, palette.colors, generator), generator)


def dead_leaves(
    height: int,
    width: int,
    colors: Colors,
    generator: np.random.Generator,
    *,
    count: int = 350,
    radii: tuple[float, float] = (0.015, 0.4),
    elongation: float | None = None,
    variation: float = 5.0,
) -> Image:
    """(H, W, 3) linear light of ellipses and boxes that hide each other, the last on top.

    Args:
        height, width: in pixels.
        colors: (N, 3) linear colours from which each shape takes one.
        generator: source of randomness.
        count: number of shapes.
        radii: smallest and largest in sizes of the image; they follow the cubic power law of natural scenes.
        elongation: ratio of a shape's axes; None for any up to 4.
        variation: standard deviation of a shape's colour, ΔE76.
    """
    size = float(min(height, width))
    texture = power_noise(height, width, generator.uniform(0.6, 1.3), generator)[..., 0]
    strength = generator.uniform(0.0, 0.25, count)
    image = np.broadcast_to(colors[generator.integers(len(colors))].astype(np.float32), (height, width, 3)).copy()
    image *= np.exp(0.2 * texture)[..., None]
    # Inverse of the cumulated density r^-3 between the two radii.
    low, high = radii[0] ** -2, radii[1] ** -2
    radius = size / np.sqrt(low + generator.random(count) * (high - low))
    shades = _vary(colors[generator.integers(0, len(colors), count)], variation, generator).astype(np.float32)
    boxes = generator.random(count) < generator.choice([0.0, 0.3, 1.0]) if elongation is None else np.zeros(count, bool)
    for index in np.argsort(-radius + generator.normal(0.0, 0.25 * size, count)):
        ratio = elongation or generator.uniform(1.0, 4.0)
        leaf = _Leaf(float(radius[index]), float(ratio), bool(boxes[index]))
        _paint_leaf(image, texture, leaf, shades[index], float(strength[index]), generator)
    return image


class _Leaf:
    """An ellipse or a box with a half-axis of `radius` pixels and the other `ratio` times shorter."""

    def __init__(self, radius: float, ratio: float, is_box: bool) -> None:
        self.radius, self.ratio, self.is_box = radius, ratio, is_box

    def level(self, along: Field, across: Field) -> Field:
        """0 in the middle, 1 on the outline."""
        x, y = along / self.radius, across * self.ratio / self.radius
        return np.maximum(np.abs(x), np.abs(y)) * 1.4 if self.is_box else np.sqrt(x * x + y * y)


def _paint_leaf(
    image: Image,
    texture: Field,
    leaf: _Leaf,
    color: NDArray[np.float32],
    strength: float,
    generator: np.random.Generator,
) -> None:
    height, width = texture.shape
    row, column = generator.uniform(0.0, height), generator.uniform(0.0, width)
    angle, light = generator.uniform(0.0, 2.0 * np.pi, 2)
    top, bottom = max(int(row - leaf.radius), 0), min(int(row + leaf.radius) + 2, height)
    left, right = max(int(column - leaf.radius), 0), min(int(column + leaf.radius) + 2, width)
    y = (np.arange(top, bottom) - row).astype(np.float32)[:, None]
    x = (np.arange(left, right) - column).astype(np.float32)[None]
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    level = leaf.level(along, across)
    cover = np.clip((1.0 - level) * leaf.radius / leaf.ratio + 0.5, 0.0, 1.0)[..., None]
    # A window of the texture moved elsewhere, so that neighbours do not share it.
    shift = generator.integers(0, height), generator.integers(0, width)
    rows = (np.arange(top, bottom) + shift[0]) % height
    grain = texture[rows][:, (np.arange(left, right) + shift[1]) % width]
    slope = (np.cos(light) * x + np.sin(light) * y) / leaf.radius
    shade = np.exp(np.float32(strength) * grain + np.float32(generator.uniform(0.0, 0.6)) * slope)
    window = image[top:bottom, left:right]
    window += cover.astype(np.float32) * (color * shade[..., None] - window)


def _vary(colors: Colors, deviation: float, generator: np.random.Generator) -> Colors:
    """(N, 3) colours displaced in CIELAB."""
    lab = linear_to_lab(colors) + generator.normal(0.0, deviation, colors.shape)
    return np.clip(lab_to_linear(lab), 0.0, 1.0)


def smooth_gradient(height: int, width: int, colors: Colors, generator: np.random.Generator) -> Image:
    """(H, W, 3) linear light blending softly from the first colour to the second."""
    field = relief(height, width, 0.3 * min(height, width), generator)
    angle = generator.uniform(0.0, 2.0 * np.pi)
    y, x = np.linspace(-1.0, 1.0, height)[:, None], np.linspace(-1.0, 1.0, width)[None]
    share = 1.0 / (1.0 + np.exp(-2.5 * (np.cos(angle) * x + np.sin(angle) * y) - 0.4 * field))
    return (colors[0] + share[..., None] * (colors[1] - colors[0])).astype(np.float32)
