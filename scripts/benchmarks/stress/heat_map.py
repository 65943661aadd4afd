"""Robustness as one picture: every axis, level and method, how far each is from failing, and the product's warnings."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ....core.errors import InputError
from ....core.files.untrusted import is_file
from ..charts import Theme, picture, write_charts
from .axes import AXES, HARMLESS, Axis
from .failure import MOST_LOST, MOST_RWE, curve
from .real import REAL, margins_of_real

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "robustness"
OURS = "layers"
PICTURE_LINES = (
    "From left to right it gets worse. Blue stands, the fainter the closer to its nearest failure line, relative to "
    "the untouched capture; red with a cross has failed, and the thick line is where it does so first.",
    "",
    picture(NAME, "Which method stands at which level of which axis, and what the product warns of"),
)
_CSV_COLUMNS = {"method", "axis", "level", "value", "psnr", "rwe", "ccpr", "ccpr_input", "failed", "warnings"}
_WIDTH, _TITLE, _ROW, _REAL_ROW, _SMALL_ROW, _NOTES = 9.5, 0.55, 0.5, 0.62, 0.24, 0.75  # inches
_LINE, _TITLE_LINE = 25, 22  # letters of a line of warnings, and of an axis
_LEAST = 1e-3  # distance to a line that shares can be of
# Lightness alone tells margins apart, so that any eye can; and failed cells have a cross.
_STANDS = {"light": ("#f3f8fc", "#5aa0d6"), "dark": ("#18242f", "#2f74ab")}
_FAILED = {"light": "#f2b8a0", "dark": "#7a3417"}
_TEXT = 7.0  # points


def read_standings(paths: Sequence[Path]) -> pd.DataFrame:
    """The rows of one or more ``stress.csv``, each compared with its own untouched capture; see `with_margins`.

    Those of a ``stress-real.csv`` have none and are compared with fixed lines; see `real.margins_of_real`.

    Raises:
        InputError: there is no such file, it is another one, or there are only rows of a ``stress-real.csv``.
    """
    tables = []
    for path in paths:
        remedy = "give a stress.csv of benchmark.py stress"
        if not is_file(path):
            raise InputError("there is no such file", where=path, remedy=remedy)
        try:
            table = pd.read_csv(path)
        except (ValueError, OSError):
            raise InputError("cannot be read as a table", where=path, remedy=remedy) from None
        if missing := sorted(_CSV_COLUMNS - set(table.columns)):
            raise InputError(f"it has no column {missing[0]}", where=path, remedy=remedy)
        table = table.fillna({"value": "", "failed": "", "warnings": ""})
        real = table[table.axis == REAL]
        tables += [real.assign(margin=margins_of_real(real), news=real.warnings)] if len(real) else []
        tables += [with_margins(table[table.axis != REAL])] if len(real) < len(table) else []
    found = pd.concat(tables, ignore_index=True)
    if (found.axis == REAL).all():
        remedy = "give a stress.csv of made-up conditions as well"
        raise InputError("there are only captures of the real world", where=paths[0], remedy=remedy)
    return found


def with_margins(items: pd.DataFrame) -> pd.DataFrame:
    """The levels of every method and axis with a column ``margin``: how far the nearest failure line is.

    1 is the untouched capture's own distance to the line, 0 is the line, below it something has failed. Of the three
    criteria the one that is nearest to its line counts. NaN where there are no figures. The column ``news`` has the
    warnings that the untouched capture has not.

    Args:
        items: of `failure.standings`, or its CSV.
    """
    rows = []
    for (method, name), _ in items[items.level != HARMLESS].groupby(["method", "axis"], sort=False):
        levels = curve(items, method, name)
        untouched = levels[levels.level == HARMLESS].iloc[0]
        margins = [
            1.0 - (untouched.psnr - levels.psnr) / MOST_LOST,
            _share(MOST_RWE - levels.rwe, MOST_RWE - untouched.rwe),
            _share(levels.ccpr - levels.ccpr_input, untouched.ccpr - untouched.ccpr_input),
        ]
        usual = set(untouched.warnings.split())
        news = [" ".join(sorted(set(warnings.split()) - usual)) for warnings in levels.warnings]
        rows.append(levels.assign(axis=name, margin=np.clip(np.min(margins, axis=0), None, 1.0), news=news))
    return pd.concat(rows, ignore_index=True)


def _share(distances: pd.Series, untouched: float) -> pd.Series:
    """Distances to a line as shares of the untouched capture's; 0 at best where that has failed itself."""
    return distances / untouched if untouched > _LEAST else distances.clip(upper=0.0)


def axes_of(items: pd.DataFrame) -> list[Axis]:
    """The axes that there are figures of, in their order."""
    return [axis for axis in AXES if (items.axis == axis.name).any()]


def write_heat_map(folder: Path, items: pd.DataFrame) -> list[Path]:
    """Write the picture, light and dark, as `write_charts` does.

    Args:
        items: of `read_standings`.
    """
    real, items = items[items.axis == REAL], items[items.axis != REAL]
    axes = axes_of(items)
    others = [method for method in items.method.unique() if method != OURS]
    columns = int(items.level.max()) + 1
    rows = math.ceil(len(real) / columns)
    middle = [_TITLE + _REAL_ROW * rows] if rows else []
    heights = [_TITLE + _ROW * len(axes), *middle, _TITLE + _SMALL_ROW * len(axes)]

    def draw(figure: Figure, theme: Theme) -> None:
        parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        _draw_panel(parts[0].subplots(), axes, items, OURS, theme)
        if rows:
            _draw_real(parts[1].subplots(), real, columns, rows, theme)
        bottom = parts[-1]
        panels = bottom.subplots(1, len(others), squeeze=False)[0]
        for panel, method in zip(panels, others, strict=True):
            _draw_panel(panel, axes, items, method, theme)
            if panel is not panels[0]:
                panel.set_yticklabels([])
        _draw_legend(figure, theme)

    return write_charts(folder, NAME, (_WIDTH, sum(heights) + _NOTES), draw, formats=("svg",))


def _draw_real(panel: Axes, items: pd.DataFrame, columns: int, rows: int, theme: Theme) -> None:
    """A cell for each capture, in reading order."""
    for place, item in enumerate(items.itertuples()):
        by = " ".join([" ×", *(reason.split()[0] for reason in item.failed.split("; "))]) if item.failed else ""
        said = _wrapped(item.news.replace(" ", ", "), _LINE)
        corner = (place % columns, place // columns)
        _draw_cell(panel, corner, f"{item.value}{by}\n{said}".strip(), item, theme)
    panel.set_yticks([rows / 2.0], [_wrapped("captures of the real world", _TITLE_LINE)])
    _finish_panel(panel, columns, rows, theme)
    panel.set_title(f"{OURS}, each capture by itself; behind the cross the line that it fails")


def _draw_cell(panel: Axes, corner: tuple[float, float], text: str, item: Any, theme: Theme) -> None:
    from matplotlib.patches import Rectangle

    panel.add_patch(Rectangle(corner, 1, 1, facecolor=_color(item.margin, item.failed, theme), linewidth=0))
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": _TEXT, "linespacing": 1.05}
    panel.text(corner[0] + 0.5, corner[1] + 0.5, text, color=theme.ink, **style)


def _finish_panel(panel: Axes, columns: int, rows: int, theme: Theme) -> None:
    panel.set(xlim=(0, columns), ylim=(rows, 0), xticks=[])
    panel.tick_params(length=0, labelsize=_TEXT + 0.5, labelcolor=theme.ink)
    panel.hlines(range(1, rows), 0, columns, color=theme.background, linewidth=2)
    panel.vlines(range(1, columns), 0, rows, color=theme.background, linewidth=1)
    panel.grid(visible=False)
    for spine in panel.spines.values():
        spine.set_visible(False)


def _draw_panel(panel: Axes, axes: Sequence[Axis], items: pd.DataFrame, method: str, theme: Theme) -> None:
    mine = items[items.method == method]
    columns = int(items.level.max()) + 1
    for row, axis in enumerate(axes):
        levels = mine[mine.axis == axis.name].sort_values("level")
        for item in levels.itertuples():
            value = axis.text(item.level) if method == OURS else _short(axis, item.level)
            value += " ×" if item.failed else ""
            said = _wrapped(item.news.replace(" ", ", "), _LINE) if method == OURS else ""
            _draw_cell(panel, (item.level, row), f"{value}\n{said}".strip(), item, theme)
        failing = levels.level[levels.failed != ""]
        if len(failing):
            line: dict[str, Any] = {"linewidth": 3, "solid_capstyle": "butt", "clip_on": False, "zorder": 3}
            panel.plot([failing.min()] * 2, [row + 0.03, row + 0.97], color=theme.ink, **line)
    panel.set_yticks(np.arange(len(axes)) + 0.5, [_wrapped(axis.title, _TITLE_LINE) for axis in axes])
    _finish_panel(panel, columns, len(axes), theme)
    panel.set_title(f"{method}, with the product's warnings" if method == OURS else method)


def _short(axis: Axis, level: int) -> str:
    """The value of a level in a narrow cell."""
    text = axis.text(level)
    return "LUT" if "LUT" in text else text.removesuffix(axis.unit)


def _wrapped(text: str, letters: int) -> str:
    return textwrap.fill(text, letters, break_on_hyphens=False, break_long_words=False)


def _color(margin: float, failed: str, theme: Theme) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    if failed:
        return to_rgb(_FAILED[theme.name])
    near, far = (np.array(to_rgb(color)) for color in _STANDS[theme.name])
    share = float(np.clip(margin, 0.0, 1.0)) if np.isfinite(margin) else 0.0
    return tuple(near + share * (far - near))


def _draw_legend(figure: Figure, theme: Theme) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    near, far = _STANDS[theme.name]
    handles = [
        Patch(facecolor=far, label="stands, far from failing"),
        Patch(facecolor=near, edgecolor=theme.muted, linewidth=0.5, label="stands, close to it"),
        Patch(facecolor=_FAILED[theme.name], label="× failed"),
        Line2D([], [], color=theme.ink, linewidth=2.5, label="where it first fails"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
