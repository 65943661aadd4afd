"""Woven patterns at yarn level: which yarn lies on top, and as images their colours and heights. numpy only.

A weave repeats seamlessly. `lift[j, i]` is true where warp yarn i passes over weft yarn j. Images have row 0 at v = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Color = NDArray[np.float64]
Lift = NDArray[np.bool_]

# How dark the valley between two yarns is, as a share of the crown's albedo, and how deep a yarn dives at a crossing.
VALLEY_ALBEDO = 0.5
CROSSING_DIP = 0.55
# Irregularity of hand-spun yarn: spread of brightness between yarns and along one yarn.
YARN_SPREAD = 0.035
SLUB_SPREAD = 0.045


@dataclass(frozen=True)
class Weave:
    """One repeat of a woven cloth.

    Attributes:
        albedo: (H, W, 3) linear sRGB.
        height: (H, W) in [0, 1], 1 on the crown of a yarn.
        width: of the repeat in metres (along the weft, u).
        depth: of the repeat in metres (along the warp, v).
        yarn: width of a yarn in metres.
    """

    albedo: NDArray[np.float32]
    height: NDArray[np.float32]
    width: float
    depth: float
    yarn: float


def plain_weave() -> Lift:
    """Over one, under one."""
    return np.array([[True, False], [False, True]])


def basket_weave(threads: int = 2) -> Lift:
    """Plain weave of pairs (or more) of threads."""
    return np.kron(plain_weave(), np.ones((threads, threads), bool)).astype(bool)


def twill(over: int = 2, under: int = 2, lean: int = 1) -> Lift:
    """Diagonal ribs: each pick shifts the floats by one thread, to the other side with a `lean` of -1."""
    period = over + under
    weft, warp = np.mgrid[:period, :period]
    return (warp - lean * weft) % period < over


def herringbone(over: int = 2, under: int = 2, band: int = 12, lean: int = 1) -> Lift:
    """Twill whose diagonal turns back every `band` warp threads."""
    period = over + under
    weft, warp = np.mgrid[:period, : 2 * band]
    direction = np.where(warp < band, warp, -warp - 1)
    return (direction - lean * weft) % period < over


def satin() -> Lift:
    """Five-end satin: the warp covers four fifths."""
    weft, warp = np.mgrid[:5, :5]
    return (2 * warp + weft) % 5 != 0


def figured(motif: NDArray[np.bool_], figure: Lift, ground: Lift) -> Lift:
    """Jacquard: one weave inside the motif, another of the same period outside; one motif pixel is one crossing.

    The motif's sides must be multiples of the weaves' period.
    """
    repeats = [side // period for side, period in zip(motif.shape, ground.shape, strict=True)]
    return np.where(motif, np.tile(figure, repeats), np.tile(ground, repeats))


def ogee_motif(columns: int, rows: int) -> NDArray[np.bool_]:
    """A damask of pointed ovals, each with a rosette of eight petals, in half-drop repeat; (rows, columns)."""
    y, x = np.mgrid[:rows, :columns].astype(float)
    x, y = (x + 0.5) / columns, (y + 0.5) / rows
    motif = np.zeros((rows, columns), bool)
    for cx, cy in ((0.5, 0.5), (0.0, 0.0)):
        dx = (x - cx + 0.5) % 1.0 - 0.5
        dy = (y - cy + 0.5) % 1.0 - 0.5
        oval = np.abs(dx) / 0.5 + (np.abs(dy) / 0.5) ** 2
        radius = np.hypot(dx * 1.0, dy * 1.35)
        petals = 0.145 + 0.055 * np.cos(8 * np.arctan2(dy * 1.35, dx))
        motif |= (oval > 0.74) & (oval < 0.9)
        motif |= (radius < petals) & (radius > 0.05)
    return motif


def sequence(*stripes: tuple[Color, int], mirrored: bool = False) -> NDArray[np.float64]:
    """(N, 3) thread colours of (colour, count) stripes; mirrored about the outer stripes as a tartan's sett is."""
    order: Sequence[tuple[Color, int]] = (*stripes, *stripes[-2:0:-1]) if mirrored else stripes
    return np.concatenate([np.tile(color, (count, 1)) for color, count in order])


def weave(
    warp: NDArray[np.float64], weft: NDArray[np.float64], lift: Lift, yarn: float, seed: int, pixels_per_yarn: int = 6
) -> Weave:
    """Weave warp colours (N, 3) and weft colours (M, 3), repeated until `lift` (p, q) fits a whole number of times.

    Args:
        yarn: width of a yarn in metres.
        seed: of the yarns' irregularities.
        pixels_per_yarn: resolution of the images.
    """
    columns = int(np.lcm(len(warp), lift.shape[1]))
    rows = int(np.lcm(len(weft), lift.shape[0]))
    p = pixels_per_yarn
    i, j = np.arange(columns * p) // p, np.arange(rows * p) // p
    over = lift[np.ix_(np.arange(rows) % lift.shape[0], np.arange(columns) % lift.shape[1])]
    warp_on_top = over[np.ix_(j, i)]

    centred = (np.arange(p) + 0.5) / p * 2 - 1
    across_warp, across_weft = np.tile(centred, columns)[None, :], np.tile(centred, rows)[:, None]
    height = np.where(
        warp_on_top,
        _yarn_height(across_warp, across_weft, over, 0, p),
        _yarn_height(across_weft, across_warp, ~over, 1, p),
    )

    rng = np.random.default_rng(seed)
    gain_warp = _irregularity(rng, columns, rows * p).T
    gain_weft = _irregularity(rng, rows, columns * p)
    color = np.where(
        warp_on_top[..., None],
        warp[np.arange(columns) % len(warp)][i][None] * gain_warp[:, i, None],
        weft[np.arange(rows) % len(weft)][j][:, None] * gain_weft[j][..., None],
    )
    shade = VALLEY_ALBEDO + (1 - VALLEY_ALBEDO) * height
    albedo = np.clip(color * (shade / shade.mean())[..., None], 0.0, 0.95)
    return Weave(albedo.astype(np.float32), height.astype(np.float32), columns * yarn, rows * yarn, yarn)


def _yarn_height(
    across: NDArray[np.float64], along: NDArray[np.float64], top: NDArray[np.bool_], axis: int, p: int
) -> NDArray[np.float64]:
    """(H, W) height of yarns that run along `axis`: round across, diving at both ends of a float.

    Args:
        across: position within the yarn in [-1, 1], broadcastable to (H, W).
        along: position within the crossing in [-1, 1], broadcastable to (H, W).
        top: (rows, columns) crossings where these yarns lie on top.
        p: pixels per yarn.
    """
    pixels = np.ones((p, p))
    ends_before = np.kron(top & ~np.roll(top, 1, axis), pixels)
    ends_after = np.kron(top & ~np.roll(top, -1, axis), pixels)
    dip = np.maximum(-along, 0) ** 2 * ends_before + np.maximum(along, 0) ** 2 * ends_after
    return np.sqrt(1 - across**2) * (1 - CROSSING_DIP * dip)


def _irregularity(rng: np.random.Generator, yarns: int, length: int) -> NDArray[np.float64]:
    """(yarns, length) brightness of hand-spun yarns about 1: one level a yarn and slow slubs along it, periodic."""
    level = 1 + YARN_SPREAD * rng.standard_normal((yarns, 1))
    phase = np.arange(length) / length * 2 * np.pi
    slub = np.zeros((yarns, length))
    for frequency in (3, 7, 13, 23):
        slub += np.cos(frequency * phase + rng.uniform(0, 2 * np.pi, (yarns, 1)))
    return level * (1 + SLUB_SPREAD * slub / 2)
