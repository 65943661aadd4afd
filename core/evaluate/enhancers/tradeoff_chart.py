"""Draws the trade-off of enhancers: what contrast is kept for how much change, a panel for each type."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..charts import Theme, plot_series, write_charts
from .table import TradeOff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANEL_WIDTH, _HEIGHT = 3.6, 3.6  # inches

Point = tuple[float, float]


def write_chart(folder: Path, name: str, points: Sequence[TradeOff], title: str) -> None:
    """Write the mean CCPR over the mean ΔE76 of each method's strengths as ``<name>.svg`` and ``<name>-dark.svg``."""
    types = len({point.cvd for point in points})
    write_charts(
        folder, name, (_PANEL_WIDTH * types, _HEIGHT), partial(_draw, points=points, title=title), formats=("svg",)
    )


def _draw(figure: Figure, theme: Theme, points: Sequence[TradeOff], title: str) -> None:
    types = list(dict.fromkeys(point.cvd for point in points))
    methods = list(dict.fromkeys(point.method for point in points))
    panels = figure.subplots(1, len(types), squeeze=False)[0]
    for panel, cvd in zip(panels, types, strict=True):
        panel.set(title=cvd, xlabel="mean ΔE76 to the original", ylabel="CCPR")
        for index, method in enumerate(methods):
            curve = _curve(points, cvd, method)
            style = theme.series[index % len(theme.series)]
            plot_series(panel, [x for x, _ in curve], [y for _, y in curve], style, method)
    figure.suptitle(title)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2 * len(types))


def _curve(points: Sequence[TradeOff], cvd: str, method: str) -> list[Point]:
    """Mean (ΔE76, CCPR) at each strength."""
    mine = [point for point in points if point.cvd == cvd and point.method == method]
    means = []
    for strength in sorted({point.strength for point in mine}):
        values = [(point.delta_e_76, point.ccpr) for point in mine if point.strength == strength]
        x, y = np.mean(values, axis=0)
        means.append((float(x), float(y)))
    return means
