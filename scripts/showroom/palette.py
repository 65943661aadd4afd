"""Colours that a colour vision deficiency confuses: found by computation, not by eye. numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.color.matrices import RGB_TO_XYZ, linear_simulation

_WHITE = RGB_TO_XYZ.sum(axis=1)
# CIE 15: where the cube root of CIELAB turns into a straight line.
_LAB_KNEE = 6.0 / 29.0

# Cloth is never as dark or as bright as the display: keeps shadows and highlights inside the range.
ALBEDO_RANGE = (0.012, 0.86)


def lab_from_linear(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """CIELAB (D65) of linear sRGB, (..., 3) to (..., 3)."""
    ratio = np.asarray(linear, np.float64) @ RGB_TO_XYZ.T / _WHITE
    f = np.where(ratio > _LAB_KNEE**3, np.cbrt(ratio), ratio / (3 * _LAB_KNEE**2) + 4.0 / 29.0)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def linear_from_lab(lab: NDArray[np.floating]) -> NDArray[np.float64]:
    """Linear sRGB of CIELAB (D65), (..., 3) to (..., 3); outside [0, 1] where the colour is out of gamut."""
    lab = np.asarray(lab, np.float64)
    fy = (lab[..., 0] + 16) / 116
    f = np.stack([fy + lab[..., 1] / 500, fy, fy - lab[..., 2] / 200], axis=-1)
    ratio = np.where(f > _LAB_KNEE, f**3, 3 * _LAB_KNEE**2 * (f - 4.0 / 29.0))
    return ratio * _WHITE @ np.linalg.inv(RGB_TO_XYZ).T


def simulate(linear: NDArray[np.floating], deficiency: str) -> NDArray[np.float64]:
    """What a dichromat sees (Machado 2009, severity 1), linear sRGB (..., 3), clipped to the display's range."""
    return np.clip(np.asarray(linear, np.float64) @ linear_simulation(deficiency, 1.0).matrix.T, 0.0, 1.0)


def difference(first: NDArray[np.floating], second: NDArray[np.floating]) -> NDArray[np.float64]:
    """ΔE76 between linear sRGB colours (..., 3)."""
    return np.linalg.norm(lab_from_linear(first) - lab_from_linear(second), axis=-1)


Color = NDArray[np.float64]


@dataclass(frozen=True)
class ConfusedPair:
    """Two linear sRGB colours that one deficiency confuses.

    Attributes:
        first: (3,) the colour that was asked for.
        second: (3,) its partner.
        normal: ΔE76 between them with normal vision.
        simulated: ΔE76 between them seen with the deficiency.
    """

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    normal: float
    simulated: float


def lch(lightness: float, chroma: float, hue: float) -> NDArray[np.float64]:
    """Linear sRGB (3,) of a CIELAB colour in cylindrical coordinates, hue in degrees."""
    angle = np.deg2rad(hue)
    return linear_from_lab(np.array([lightness, chroma * np.cos(angle), chroma * np.sin(angle)]))


def confused_pair(
    first: NDArray[np.float64], deficiency: str, wanted: float, lightness_span: float, limit: float
) -> ConfusedPair:
    """The partner of `first`: at most `limit` ΔE76 away in S, at least `wanted` in normal vision, of the least chroma.

    Searches CIELAB on a grid of one unit of a* and b*, at the same L* or up to `lightness_span` away from it (protan
    confusions are of unequal lightness: reds look dark). Where nothing is as far as `wanted`, the farthest is taken.
    """
    lightness = lab_from_linear(first)[0]
    axis = np.arange(-100.0, 101.0)
    levels = lightness + np.arange(-lightness_span, lightness_span + 1.0, 3.0)
    lab = np.stack(np.meshgrid(levels, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    low, high = ALBEDO_RANGE
    colors = linear_from_lab(lab)
    usable = np.all((colors >= low) & (colors <= high), axis=-1)
    usable[usable] = difference(simulate(colors[usable], deficiency), simulate(first, deficiency)) <= limit
    lab, colors = lab[usable], colors[usable]
    normal = difference(colors, first)
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    far = normal >= wanted
    best = np.argmin(np.where(far, chroma, np.inf)) if far.any() else np.argmax(normal)
    simulated = difference(simulate(first, deficiency), simulate(colors[best], deficiency))
    return ConfusedPair(first, colors[best], float(normal[best]), float(simulated))


@dataclass(frozen=True)
class Palette:
    """The colours of one showroom, linear sRGB. The pairs are those that its deficiency confuses."""

    tartan: ConfusedPair
    stripe: ConfusedPair
    herringbone: ConfusedPair
    jacquard: ConfusedPair
    cream: Color
    dark: Color
    satin: Color
    sheer: Color


# Of each showroom: lightness, chroma and hue (degrees) of a pair's first colour, ΔE76 wanted, span of the lightness.
_PAIRS = {
    "deutan": ((44, 46, 28, 58, 0), (61, 48, 48, 48, 0), (66, 30, 355, 46, 0), (52, 38, 10, 50, 0)),
    "protan": ((48, 46, 35, 55, 12), (60, 46, 75, 46, 9), (66, 24, 345, 44, 9), (52, 30, 20, 44, 9)),
    "tritan": ((50, 45, 135, 34, 0), (72, 62, 85, 38, 0), (58, 50, 135, 34, 0), (66, 50, 75, 32, 0)),
}
# ΔE76 in S that still counts as confused: Machado's tritan leaves much of the blue-yellow contrast, and its pairs are
# the most there is.
_LIMITS = {"deutan": 4.0, "protan": 4.0, "tritan": 5.5}
_OTHERS = {  # dark, satin, sheer
    "deutan": ((24, 14, 265), (54, 40, 12), (84, 16, 150)),
    "protan": ((24, 14, 265), (58, 36, 45), (84, 16, 200)),
    "tritan": ((28, 20, 20), (62, 28, 195), (84, 16, 90)),
}


def palette(deficiency: str) -> Palette:
    """The palette whose pairs `deficiency` ("protan", "deutan" or "tritan") confuses."""
    tartan, stripe, herringbone, jacquard = (
        confused_pair(lch(*first), deficiency, wanted, lightness_span=span, limit=_LIMITS[deficiency])
        for *first, wanted, span in _PAIRS[deficiency]
    )
    dark, satin, sheer = (lch(*color) for color in _OTHERS[deficiency])
    return Palette(tartan, stripe, herringbone, jacquard, lch(88, 8, 85), dark, satin, sheer)
