"""The curves of a stress test: a row of panels an axis, a column a figure, a series a method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...charts import SeriesStyle, Theme, plot_series, write_charts
from .axes import HARMLESS, Axis
from .failure import MOST_LOST, MOST_RWE, UNTOUCHED, Standing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _ROW, _LEGEND = 9.0, 1.75, 0.6  # inches
_COLUMNS = {"psnr": "PSNR, dB", "rwe": "RWE", "ccpr": "CCPR"}
_SPREAD_ALPHA = 0.18


def write_stress_chart(folder: Path, name: str, axes: Sequence[Axis], items: Sequence[Standing]) -> list[Path]:
    """Write the chart as `write_charts` does.

    Raises:
        InputError: matplotlib is missing.
    """

    def draw(figure: Figure, theme: Theme) -> None:
        panels = figure.subplots(len(axes), len(_COLUMNS), squeeze=False)
        for number, axis in enumerate(axes):
            for panel, (key, title) in zip(panels[number], _COLUMNS.items(), strict=True):
                _draw_panel(panel, axis, key, items, theme)
                panel.set_ylabel(title)
            unit = axis.unit.strip()
            panels[number][0].set_title(f"{axis.title}, {unit}" if unit else axis.title)
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))

    return write_charts(folder, name, (_WIDTH, _LEGEND + _ROW * len(axes)), draw)


def curve(items: Sequence[Standing], method: str, axis: str) -> list[Standing]:
    """A method's levels on an axis, in order, from the harmless one on: its own, or that which axes share."""
    by_level = {
        item.level: item for name in (UNTOUCHED, axis) for item in items if item.method == method and item.axis == name
    }
    return [by_level[level] for level in sorted(by_level)]


def methods_of(items: Sequence[Standing]) -> list[str]:
    """Their names, in the order in which they come."""
    return list(dict.fromkeys(item.method for item in items))


def _draw_panel(panel: Axes, axis: Axis, key: str, items: Sequence[Standing], theme: Theme) -> None:
    for method, style in zip(methods_of(items), theme.series, strict=False):
        levels = curve(items, method, axis.name)
        _draw_curve(panel, levels, key, style, method)
        if key == "psnr":
            _draw_line(panel, levels[0].psnr - MOST_LOST, style.color)
    if key == "rwe":
        _draw_line(panel, MOST_RWE, theme.muted)
    elif key == "ccpr":
        inputs = curve(items, methods_of(items)[0], axis.name)
        panel.plot([i.level for i in inputs], [i.ccpr_input for i in inputs], color=theme.muted, ls=":", lw=1)
    levels_shown = sorted({HARMLESS, *(item.level for item in items)})
    panel.set_xticks(levels_shown, [axis.text(level).removesuffix(axis.unit) for level in levels_shown])


def _draw_curve(panel: Axes, levels: Sequence[Standing], key: str, style: SeriesStyle, method: str) -> None:
    x = np.array([item.level for item in levels])
    y = np.array([getattr(item, key) for item in levels])
    deviation = np.nan_to_num([getattr(item, f"{key}_deviation") for item in levels])
    panel.fill_between(x, y - deviation, y + deviation, color=style.color, alpha=_SPREAD_ALPHA, linewidth=0)
    plot_series(panel, x, y, style, method)


def _draw_line(panel: Axes, height: float, color: str) -> None:
    """A failure line."""
    if np.isfinite(height):
        panel.axhline(height, color=color, linestyle=":", linewidth=1)
