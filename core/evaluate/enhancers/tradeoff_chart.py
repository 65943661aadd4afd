"""Draws the trade-off of enhancers as SVG: what contrast is kept for how much change, a panel for each type.

Methods differ in marker and in lightness, not in hue alone, so that the chart can be read with any colour vision.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from .table import TradeOff

_PANEL_WIDTH, _PANEL_HEIGHT = 380, 320
_LEFT, _TOP, _BOTTOM, _RIGHT = 52, 44, 46, 14  # margins of a panel
_LEGEND_LINE = 20
_RADIUS = 5
# Okabe and Ito (2008), "Color universal design", from dark to light; each with a marker of its own.
_STYLES = (
    ("#000000", "circle"),
    ("#0072b2", "square"),
    ("#d55e00", "triangle"),
    ("#009e73", "diamond"),
    ("#cc79a7", "cross"),
    ("#e69f00", "square"),
    ("#56b4e9", "triangle"),
)

Point = tuple[float, float]


def write_chart(path: Path, points: Sequence[TradeOff], title: str) -> None:
    """Write the mean CCPR over the mean ΔE76 of each method's strengths."""
    types = list(dict.fromkeys(point.cvd for point in points))
    methods = list(dict.fromkeys(point.method for point in points))
    curves = {(cvd, method): _curve(points, cvd, method) for cvd in types for method in methods}
    drawn = np.array([point for curve in curves.values() for point in curve] or [(0.0, 0.0)])
    x_top = max(float(np.ceil(drawn[:, 0].max())), 1.0)
    y_bottom, y_top = np.floor(20 * drawn[:, 1].min()) / 20, np.ceil(20 * drawn[:, 1].max() + 1e-9) / 20
    parts = [_text(_LEFT, 18, title, size=14)]
    for column, cvd in enumerate(types):
        panel = _Panel(column * _PANEL_WIDTH, x_top, float(y_bottom), float(y_top))
        parts += panel.axes(f"{cvd}, mean ΔE76 to the original")
        for index, method in enumerate(methods):
            color, marker = _STYLES[index % len(_STYLES)]
            parts += panel.curve(curves[cvd, method], color, marker)
    for index, method in enumerate(methods):
        color, marker = _STYLES[index % len(_STYLES)]
        y = _PANEL_HEIGHT + _LEGEND_LINE * (index + 0.5)
        parts += [_marker(_LEFT, y, color, marker), _text(_LEFT + 14, y + 4, method)]
    width = max(_PANEL_WIDTH * len(types), _PANEL_WIDTH)
    height = _PANEL_HEIGHT + _LEGEND_LINE * len(methods) + 10
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">'
    background = f'<rect width="{width}" height="{height}" fill="white"/>'
    path.write_text("\n".join([head, background, *parts, "</svg>"]) + "\n", encoding="utf-8")


def _curve(points: Sequence[TradeOff], cvd: str, method: str) -> list[Point]:
    """Mean (ΔE76, CCPR) at each strength."""
    mine = [point for point in points if point.cvd == cvd and point.method == method]
    means = []
    for strength in sorted({point.strength for point in mine}):
        values = [(point.delta_e_76, point.ccpr) for point in mine if point.strength == strength]
        x, y = np.mean(values, axis=0)
        means.append((float(x), float(y)))
    return means


class _Panel:
    """A pair of axes whose left edge lies at `offset`."""

    def __init__(self, offset: float, x_top: float, y_bottom: float, y_top: float) -> None:
        self._offset, self._x_top, self._y_bottom, self._y_top = offset, x_top, y_bottom, y_top

    def axes(self, label: str) -> list[str]:
        """Grid lines with numbers, and what they are of."""
        parts = []
        for x in np.linspace(0.0, self._x_top, 5):
            (left, bottom), (_, top) = self._at((x, self._y_bottom)), self._at((x, self._y_top))
            parts += [_line(left, bottom, left, top), _text(left, bottom + 16, f"{x:.3g}", anchor="middle")]
        for y in np.linspace(self._y_bottom, self._y_top, 5):
            (left, level), (right, _) = self._at((0.0, y)), self._at((self._x_top, y))
            parts += [_line(left, level, right, level), _text(left - 6, level + 4, f"{y:.3f}", anchor="end")]
        middle, bottom = self._at((self._x_top / 2.0, self._y_bottom))
        left, top = self._at((0.0, self._y_top))
        return [*parts, _text(middle, bottom + 34, label, anchor="middle"), _text(left, top - 8, "CCPR")]

    def curve(self, points: Sequence[Point], color: str, marker: str) -> list[str]:
        """The points, joined in their order."""
        placed = [self._at(point) for point in points]
        joined = " ".join(f"{x:.1f},{y:.1f}" for x, y in placed)
        line = f'<polyline points="{joined}" fill="none" stroke="{color}" stroke-width="1.5"/>'
        return [line, *(_marker(x, y, color, marker) for x, y in placed)]

    def _at(self, point: Point) -> Point:
        x = point[0] / self._x_top
        y = (point[1] - self._y_bottom) / max(self._y_top - self._y_bottom, 1e-9)
        return (
            self._offset + _LEFT + x * (_PANEL_WIDTH - _LEFT - _RIGHT),
            _PANEL_HEIGHT - _BOTTOM - y * (_PANEL_HEIGHT - _TOP - _BOTTOM),
        )


def _marker(x: float, y: float, color: str, kind: str) -> str:
    r = _RADIUS
    if kind == "circle":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" fill="{color}"/>'
    if kind == "cross":
        return f'<path d="M{x - r:.1f} {y - r:.1f}l{2 * r} {2 * r}m0 {-2 * r}l{-2 * r} {2 * r}" stroke="{color}"/>'
    corners = {
        "square": [(-r, -r), (r, -r), (r, r), (-r, r)],
        "triangle": [(0, -r), (r, r), (-r, r)],
        "diamond": [(0, -r), (r, 0), (0, r), (-r, 0)],
    }[kind]
    joined = " ".join(f"{x + dx:.1f},{y + dy:.1f}" for dx, dy in corners)
    return f'<polygon points="{joined}" fill="{color}"/>'


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="#dddddd"/>'


def _text(x: float, y: float, text: str, *, size: int = 11, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}">{escape(text)}</text>'
