"""The style of all charts: light and dark, as SVG and PNG, readable with any colour vision.

Series differ in colour, marker and dash at once. matplotlib comes with the extra ``bench`` and is imported when a chart
is drawn; everything else works without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PIXELS_PER_INCH = 110
_STAR = 11  # points

Dash = str | tuple[int, tuple[int, ...]]
"""The name of a dash pattern, or its offset and the lengths of strokes and gaps in points."""


@dataclass(frozen=True)
class SeriesStyle:
    """The style of one series.

    Attributes:
        color: sRGB as ``#rrggbb``.
        marker, dash: matplotlib's names.
    """

    color: str
    marker: str
    dash: Dash


# Okabe and Ito (2008), "Color universal design", without yellow, which is lost on white; black is the theme's ink.
_HUES = ("#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#56b4e9")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_DASHES: tuple[Dash, ...] = (
    "solid",
    (0, (6, 2)),
    (0, (2, 2)),
    (0, (8, 2, 2, 2)),
    (0, (4, 1, 1, 1, 1, 1)),
    (0, (1, 1)),
    (0, (10, 3)),
)


@dataclass(frozen=True)
class Theme:
    """The colours of a page.

    Attributes:
        name: "light" or "dark".
        suffix: of file names.
        background, ink, muted, grid: sRGB as ``#rrggbb``; `muted` is for secondary text.
    """

    name: str
    suffix: str
    background: str
    ink: str
    muted: str
    grid: str

    @property
    def series(self) -> tuple[SeriesStyle, ...]:
        """The styles of up to seven series; the last is in ink."""
        colors = (*_HUES, self.ink)
        return tuple(
            SeriesStyle(color, marker, dash) for color, marker, dash in zip(colors, _MARKERS, _DASHES, strict=True)
        )


LIGHT = Theme("light", "", background="#ffffff", ink="#111111", muted="#555555", grid="#dddddd")
DARK = Theme("dark", "-dark", background="#0d1117", ink="#f0f0f0", muted="#aaaaaa", grid="#333a44")

Draw = Callable[["Figure", Theme], None]


def write_charts(
    folder: Path, name: str, size: tuple[float, float], draw: Draw, *, formats: Sequence[str] = ("svg", "png")
) -> list[Path]:
    """Write ``<name>.svg``, ``<name>.png`` and both with ``-dark``; the same data give the same bytes of SVG.

    Args:
        size: width and height in inches.
        draw: draws on an empty figure.
        formats: to write.

    Raises:
        InputError: matplotlib is missing.
    """
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError:
        remedy = "install the extra 'bench' (pip install -e .[bench])"
        raise InputError("charts are drawn with matplotlib, which is missing", remedy=remedy) from None
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for theme in (LIGHT, DARK):
        with matplotlib.rc_context(_parameters(theme, salt=name)):
            figure = Figure(figsize=size, layout="constrained")
            draw(figure, theme)
            for kind in formats:
                written.append(folder / f"{name}{theme.suffix}.{kind}")
                metadata = {"Date": None} if kind == "svg" else None
                figure.savefig(written[-1], dpi=PIXELS_PER_INCH, metadata=metadata)
    return written


def picture(name: str, alternative: str, kind: str = "svg") -> str:
    """HTML for a Markdown page that shows the chart `name`, the dark one in dark mode.

    Args:
        alternative: a sentence about the chart for readers who cannot see it.
        kind: suffix of the files.
    """
    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{name}{DARK.suffix}.{kind}">'
        f'<img src="{name}.{kind}" alt="{escape(alternative)}"></picture>'
    )


def plot_series(
    axes: Axes, x: Any, y: Any, style: SeriesStyle, label: str, *, joined: bool = True, **more: Any
) -> None:
    """Draw a series in its style.

    Args:
        x, y: (N,) each.
        joined: whether a line joins the points, in their order.
        more: further arguments of `Axes.plot`.
    """
    dash = style.dash if joined else "none"
    axes.plot(x, y, color=style.color, marker=style.marker, linestyle=dash, label=label, **more)


@dataclass(frozen=True)
class Curve:
    """A series of `draw_curves`.

    Attributes:
        panel: which it is in.
        label: of the series, with one style in all panels.
        x, y: (N,) each.
    """

    panel: str
    label: str
    x: Sequence[float]
    y: Sequence[float]


def draw_curves(figure: Figure, theme: Theme, curves: Sequence[Curve], *, y: str, x: str, columns: int) -> None:
    """A panel beside the other for each name of one, over a logarithmic axis; one legend below.

    Args:
        y, x: what the axes show; the panels' names come before y in their titles.
        columns: of the legend.
    """
    names = list(dict.fromkeys(curve.panel for curve in curves))
    styles = dict(zip(dict.fromkeys(curve.label for curve in curves), theme.series, strict=False))
    panels = figure.subplots(1, len(names), squeeze=False)[0]
    for panel, name in zip(panels, names, strict=True):
        logarithmic(panel)
        panel.set(title=f"{name}: {y}", xlabel=x)
        for curve in curves:
            if curve.panel == name:
                plot_series(panel, curve.x, curve.y, styles[curve.label], curve.label, markersize=4)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def plot_stars(axes: Axes, x: Any, y: Any, theme: Theme, label: str) -> None:
    """Draw (N,) points as outlined stars in front of everything else."""
    outline = {"markersize": _STAR, "markeredgecolor": theme.ink, "zorder": 4}
    plot_series(axes, x, y, SeriesStyle(theme.background, "*", "none"), label, joined=False, **outline)


def logarithmic(axes: Axes) -> None:
    """Make the x axis logarithmic, with plain numbers at 1, 2 and 5 of every decade."""
    from matplotlib.ticker import LogLocator, NullLocator

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter("{x:,g}")


def _parameters(theme: Theme, salt: str) -> Any:
    """matplotlib settings for a theme; a fixed `salt` keeps the identifiers in the SVG stable."""
    return {
        "figure.facecolor": theme.background,
        "savefig.facecolor": theme.background,
        "axes.facecolor": theme.background,
        "axes.edgecolor": theme.muted,
        "axes.labelcolor": theme.ink,
        "axes.titlecolor": theme.ink,
        "axes.titlesize": "medium",
        "axes.titlelocation": "left",
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "grid.color": theme.grid,
        "grid.linewidth": 0.6,
        "text.color": theme.ink,
        "xtick.color": theme.muted,
        "ytick.color": theme.muted,
        "legend.frameon": False,
        "legend.fontsize": "small",
        "font.family": "sans-serif",
        "font.size": 9,
        "lines.linewidth": 1.5,
        "lines.markersize": 5,
        "svg.fonttype": "none",  # text stays text
        "svg.hashsalt": salt,
    }
