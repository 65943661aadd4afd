"""Photographs of woven cloth, yarn by yarn: `showroom.weaves` says what is on top, warp and weft in which colour.

Plain weave, twill, herringbone, satin and jacquard differ in what is on top; stripes, checks and tartans in the order
of the coloured yarns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...showroom.weaves import Lift, figured, herringbone, plain_weave, satin, twill
from .appearance import ClothView, expose, view_cloth
from .fields import Colors, Field, Image, halve, power_noise, relief
from .palettes import Palette

Pixels = NDArray[np.uint8]

_DIFFERENT_YARNS = 509  # in thickness, of each direction; a prime, so that no repeat is seen


@dataclass(frozen=True)
class Cloth:
    """A woven cloth.

    Attributes:
        warp, weft: (N, 3) linear colours of the yarns, in order; repeated endlessly.
        lift: (Q, P) where warp yarns pass over weft yarns, as in `showroom.weaves`; repeated endlessly.
        pitch: distance of yarns in pixels.
        relief: 0 flat to 1 round yarns with dark gaps.
        irregularity: relative standard deviation of the yarns' brightness.
        melange: relative standard deviation of the fibres' brightness along the yarns.
    """

    warp: Colors
    weft: Colors
    lift: Lift
    pitch: float
    relief: float
    irregularity: float
    melange: float


def weave(cloth: Cloth, view: ClothView, generator: np.random.Generator) -> Image:
    """(H, W, 3) linear light from a cloth as seen in `view`."""
    u, v = view.across / np.float32(cloth.pitch), view.along / np.float32(cloth.pitch)
    column, row = np.floor(u).astype(np.int32), np.floor(v).astype(np.int32)
    across_warp, across_weft = u - column - np.float32(0.5), v - row - np.float32(0.5)
    warp_on_top = cloth.lift[row % cloth.lift.shape[0], column % cloth.lift.shape[1]]
    warp, weft = cloth.warp.astype(np.float32), cloth.weft.astype(np.float32)
    color = np.where(warp_on_top[..., None], warp[column % len(warp)], weft[row % len(weft)])
    across = np.where(warp_on_top, across_warp, across_weft)
    along = np.where(warp_on_top, across_weft, across_warp)
    # A yarn is a cylinder that dives under its neighbours at both ends of a float.
    rounded = 1.0 - np.float32(cloth.relief) * (1.6 * across**2 + 0.9 * along**2)
    light = rounded * _yarn_brightness(column, row, warp_on_top, cloth.irregularity, generator)
    if cloth.melange > 0.0:
        fibres = power_noise(*view.shape, 0.4, generator)[..., 0]
        light = light * np.exp(np.float32(cloth.melange) * fibres)
    return color * (light * view.shading)[..., None]


def _yarn_brightness(
    column: NDArray[np.int32],
    row: NDArray[np.int32],
    warp_on_top: NDArray[np.bool_],
    deviation: float,
    generator: np.random.Generator,
) -> Field:
    warp, weft = generator.lognormal(0.0, deviation, (2, _DIFFERENT_YARNS)).astype(np.float32)
    return np.where(warp_on_top, warp[column % _DIFFERENT_YARNS], weft[row % _DIFFERENT_YARNS])


def _photograph(
    warp: Colors,
    weft: Colors,
    lift: Lift,
    height: int,
    width: int,
    generator: np.random.Generator,
    pitch: tuple[float, float] = (1.2, 4.0),
    view: ClothView | None = None,
) -> Pixels:
    """Weave the yarns with random workmanship, look at the cloth and photograph it."""
    cloth = Cloth(
        warp=warp,
        weft=weft,
        lift=lift,
        pitch=float(np.exp(generator.uniform(*np.log(pitch)))),
        relief=generator.uniform(0.2, 1.0),
        irregularity=generator.uniform(0.0, 0.12),
        melange=generator.choice([0.0, generator.uniform(0.03, 0.25)]),
    )
    view = view or view_cloth(height, width, generator)
    return expose(halve(weave(cloth, view, generator)), generator)


_TWILL = twill(lean=-1)
_WEAVES = (plain_weave(), _TWILL, twill(2, 1, -1), twill(3, 1, -1), satin(), herringbone(band=8, lean=-1))


def _repeat(colors: Colors, counts: NDArray[np.int64]) -> Colors:
    return np.repeat(colors, counts, axis=0)


def sett(palette: Palette, generator: np.random.Generator) -> Colors:
    """(N, 3) yarns of a tartan: a few thread counts, mirrored at both ends as traditional setts are."""
    used = int(generator.integers(2, 6))
    bands = int(generator.integers(max(3, used), 10))
    order = np.concatenate([np.arange(used), generator.integers(0, used, bands - used)])
    # Broad grounds and hairline stripes: thread counts are even and spread over more than a decade.
    counts = 2 * np.maximum(np.exp(generator.uniform(np.log(1.0), np.log(20.0), bands)).astype(int), 1)
    half = _repeat(palette.colors[generator.permutation(order)], counts)
    return np.concatenate([half, half[::-1]])


def draw_tartan(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """The same sett in warp and weft, in twill."""
    yarns = sett(palette, generator)
    return _photograph(yarns, yarns, _TWILL, height, width, generator, (0.8, 3.0))


def draw_stripes(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Coloured warps, regular or irregular, under one weft that hardly shows."""
    used = int(generator.integers(2, 7))
    bands = used * int(generator.integers(1, 4))
    counts = generator.integers(2, int(generator.integers(6, 60)), bands)
    if generator.random() < 0.5:
        counts[:] = counts[0]
    warp = _repeat(palette.colors[np.arange(bands) % used], counts)
    weft = palette.colors[generator.integers(used), None]
    lift = satin() if generator.random() < 0.5 else twill(3, 1, -1)
    return _photograph(warp, weft, lift, height, width, generator, (0.8, 3.0))


def draw_checks(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Gingham, windowpane, houndstooth and buffalo checks."""
    style = generator.integers(3)
    if style == 0:  # houndstooth: four and four in 2/2 twill
        yarns = _repeat(palette.colors[:2], np.array([4, 4]))
        return _photograph(yarns, yarns, _TWILL, height, width, generator, (1.5, 7.0))
    count = int(generator.integers(4, 30))
    counts = np.array([count, count]) if style == 1 else np.array([count + 8, int(generator.integers(1, 4))])
    warp = _repeat(palette.colors[:2], counts)
    weft = warp if generator.random() < 0.7 else _repeat(palette.colors[2:4], counts)
    lift = plain_weave() if generator.random() < 0.6 else _TWILL
    return _photograph(warp, weft, lift, height, width, generator, (0.8, 3.5))


def draw_yarns(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """One colour in the warp and another in the weft, close enough to see the yarns; or heathered within each."""
    colors = palette.colors[:2, None]
    if generator.random() < 0.4:
        mixed = palette.colors[generator.integers(0, 4, (2, 97))]
        colors = colors + generator.uniform(0.2, 0.8) * (mixed - colors)
    return _photograph(
        colors[0], colors[1], _WEAVES[generator.integers(len(_WEAVES))], height, width, generator, (3.0, 16.0)
    )


def draw_jacquard(height: int, width: int, palette: Palette, generator: np.random.Generator) -> Pixels:
    """Figures that the weave itself draws: weft-faced within them, warp-faced around them."""
    period = 20 * int(generator.integers(2, 7))
    lift = figured(_motif(period, generator), ~satin(), satin())
    weft = palette.colors[1:2]
    if generator.random() < 0.3:  # a lancé: the figure changes colour from row to row of figures
        weft = _repeat(palette.colors[1:3], np.array([period, period]))
    return _photograph(palette.colors[:1], weft, lift, height, width, generator, (0.8, 3.0))


def _motif(period: int, generator: np.random.Generator) -> NDArray[np.bool_]:
    """(period, period) a tileable figure: the level set of a few symmetric waves, as damasks have."""
    angle = 2.0 * np.pi * np.arange(period) / period
    x, y = np.meshgrid(angle, angle)
    field = np.zeros((period, period))
    for _ in range(generator.integers(2, 6)):
        first, second = generator.integers(0, 4, 2)
        field += generator.normal() * np.cos(first * x) * np.cos(second * y + generator.choice([0.0, np.pi / 2.0]))
    if generator.random() < 0.3:
        field += 0.5 * field.std() * relief(period, period, period / 8, generator)
    return (field > np.quantile(field, generator.uniform(0.35, 0.75))).T
