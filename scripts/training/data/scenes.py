"""Stand-ins for photographs of nature and people: foliage with fruit, landscapes, still lifes, skin; and mixtures."""

from __future__ import annotations

import numpy as np

from .appearance import expose
from .fields import Colors, Image, power_noise, relief
from .palettes import Palette, foliage, fruits, skin_tones, whites
from .patches import Pixels, dead_leaves, smooth_gradient


def draw_foliage(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Leaves, and among them small fruits or flowers: what red-green deficiency makes hard to find."""
    greens = foliage(24, generator)
    scale = generator.uniform(0.5, 1.6)
    scene = dead_leaves(
        height,
        width,
        greens,
        generator,
        count=int(generator.integers(250, 700)),
        radii=(0.02 * scale, 0.2 * scale),
        elongation=generator.uniform(1.3, 3.5),
        variation=generator.uniform(2.0, 9.0),
    )
    accents = fruits(4, generator) if palette.confuses is None else _beside(greens, palette)
    radius = min(height, width) * generator.uniform(0.01, 0.06)
    for _ in range(generator.integers(5, 60)):
        _paint_ball(scene, accents[generator.integers(len(accents))], radius * generator.uniform(0.7, 1.2), generator)
    return expose(scene * _dappled(height, width, generator), generator)


def _beside(greens: Colors, palette: Palette) -> Colors:
    """The palette's confused colours, as light as the leaves."""
    scale = greens.mean() / max(palette.colors[:2].mean(), 1e-3)
    return np.clip(palette.colors[:2] * min(scale * 1.2, 1.0 / palette.colors[:2].max()), 0.0, 1.0)


def draw_still_life(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """A heap of shaded, mottled balls on a plain or textured ground: fruit, wool, toys."""
    ground = np.vstack([whites(1, generator), palette.colors[4:6]])
    scene = smooth_gradient(height, width, ground[generator.permutation(3)[:2]], generator)
    scene *= np.exp(generator.uniform(0.0, 0.2) * power_noise(height, width, 1.0, generator))
    colors = fruits(6, generator) if palette.confuses is None and generator.random() < 0.6 else palette.colors[:6]
    radius = min(height, width) * np.exp(generator.uniform(np.log(0.05), np.log(0.25)))
    for _ in range(generator.integers(6, 50)):
        color = colors[generator.integers(len(colors))]
        _paint_ball(scene, color, radius * generator.uniform(0.7, 1.3), generator)
    return expose(scene, generator)


def _paint_ball(scene: Image, color: Colors, radius: float, generator: np.random.Generator) -> None:
    """A lit ball with a soft shadow under it, a highlight and a mottled skin that turns towards another hue."""
    height, width = scene.shape[:2]
    row, column = generator.uniform(0.0, height), generator.uniform(0.0, width)
    reach = radius * 1.3
    top, bottom = max(int(row - reach), 0), min(int(row + reach) + 2, height)
    left, right = max(int(column - reach), 0), min(int(column + reach) + 2, width)
    y = ((np.arange(top, bottom) - row) / radius).astype(np.float32)[:, None]
    x = ((np.arange(left, right) - column) / radius).astype(np.float32)[None]
    squared = x * x + y * y
    window = scene[top:bottom, left:right]
    window *= 1.0 - 0.5 * np.exp(-3.0 * ((x - 0.15) ** 2 + (y - 0.2) ** 2))[..., None]  # what the ball shadows
    z = np.sqrt(np.clip(1.0 - squared, 0.0, 1.0))
    light = np.clip(-0.35 * x - 0.5 * y + 0.79 * z, 0.0, None)
    other = np.clip(color * generator.uniform(0.75, 1.3, 3), 0.0, 1.0)
    turn = np.clip(0.5 + 0.7 * (x * np.cos(row) + y * np.sin(row)), 0.0, 1.0)[..., None]
    skin = (color + turn * (other - color)) * (0.25 + 0.8 * light)[..., None]
    skin = skin + generator.uniform(0.0, 0.4) * light[..., None] ** 40
    cover = np.clip((1.0 - np.sqrt(squared)) * radius + 0.5, 0.0, 1.0)[..., None]
    window += (cover * (skin - window)).astype(np.float32)


def draw_landscape(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """A clouded sky over receding ridges, with fields, soil or water in front."""
    sky = smooth_gradient(height, width, _sky(generator), generator)
    clouds = np.clip(power_noise(height, width, 1.6, generator) * 0.35 + generator.uniform(-0.3, 0.3), 0.0, 1.0)
    scene = sky + clouds * (np.float32(0.95) * np.float32(generator.uniform(0.6, 1.0)) - sky)
    rows = np.arange(height, dtype=np.float32)[:, None]
    ridges = int(generator.integers(1, 5))
    lines = np.sort(generator.uniform(0.25, 0.85, ridges)) * height
    colors = np.vstack([foliage(3, generator), palette.colors[:3]])
    for index, line in enumerate(lines):
        outline = line + 0.06 * height * power_noise(1, width, 1.2, generator)[0, :, 0]
        distance = (ridges - 1 - index) / ridges
        chosen = colors[generator.permutation(len(colors))[:3]]
        count, near = int(generator.integers(60, 300)), 0.02 + 0.03 * (1 - distance)
        ground = dead_leaves(height, width, chosen, generator, count=count, radii=(near / 2, near * 4), variation=4.0)
        ground = ground + np.float32(0.6 * distance) * (sky.mean((0, 1)) - ground)  # haze
        scene = np.where((rows > outline[None])[..., None], ground, scene)
    return expose(scene.astype(np.float32), generator)


def _sky(generator: np.random.Generator) -> Colors:
    """(2, 3) linear colours: day, overcast, dusk."""
    skies = [
        [[0.16, 0.33, 0.72], [0.55, 0.72, 0.92]],
        [[0.45, 0.48, 0.52], [0.8, 0.82, 0.85]],
        [[0.25, 0.22, 0.42], [0.95, 0.5, 0.25]],
        [[0.01, 0.015, 0.04], [0.05, 0.08, 0.16]],
    ]
    return np.array(skies[generator.integers(len(skies))]) * generator.uniform(0.7, 1.05)


def draw_portrait(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Skin-like rounded areas before a background, with cloth, hair and whites beside them."""
    scene = dead_leaves(height, width, palette.colors, generator, count=80, radii=(0.05, 0.6), variation=3.0)
    size = float(min(height, width))
    for _ in range(generator.integers(1, 4)):
        skin = skin_tones(1, generator)[0]
        row, column = generator.uniform(0.2, 0.8, 2) * [height, width]
        axes = size * generator.uniform(0.12, 0.35) * np.array([1.3, 1.0])
        y = ((np.arange(height) - row) / axes[0]).astype(np.float32)[:, None]
        x = ((np.arange(width) - column) / axes[1]).astype(np.float32)[None]
        level = np.sqrt(x * x + y * y)
        hair = np.clip((1.25 - np.sqrt(x * x + (y + 0.35) ** 2)) * axes[1] / 4.0, 0.0, 1.0)[..., None]
        dark = np.array([0.06, 0.035, 0.02]) * generator.uniform(0.3, 6.0)
        strands = np.exp(0.3 * power_noise(height, width, 0.7, generator))
        scene = scene + hair * (dark * strands - scene)
        form = np.exp(-0.5 * np.clip(level, 0.0, 1.2) ** 2 + 0.35 * x * generator.choice([-1.0, 1.0]))
        flush = 1.0 + 0.06 * relief(height, width, axes[0] / 4.0, generator)[..., None] * np.array([1.0, -0.4, -0.4])
        cover = np.clip((1.0 - level) * axes[1] / 3.0, 0.0, 1.0)[..., None]
        scene = scene + cover * (skin * form[..., None] * flush * 1.15 - scene)
    return expose(scene.astype(np.float32), generator)


def _dappled(height: int, width: int, generator: np.random.Generator) -> Image:
    """(H, W, 1) spots of sun and shade."""
    field = relief(height, width, min(height, width) * generator.uniform(0.05, 0.3), generator)
    return np.exp(generator.uniform(0.0, 0.6) * field)[..., None]
