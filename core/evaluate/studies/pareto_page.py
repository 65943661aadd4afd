"""The chart, the table and the page of speed against accuracy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

from ..charts import SeriesStyle, Theme, logarithmic, picture, plot_series, write_charts
from ..tables import markdown_table, number, write_csv
from .pareto import DEFAULT, PEER, SERIES, ParetoPoint

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "pareto"
_SIZE = (10.0, 7.6)  # inches
_STAR = 11  # points
_MARGIN = 0.08  # around what is plotted, in widths and heights of a chart: names of points stand there
_SERIES_NAMES = {
    "steps": "steps of training",
    "photographs": "smaller photographs",
    "limit": "fixed number of Gaussians",
    "SH degree": "SH degree",
    "mode": "mode",
    "enhancer": "enhancer",
}
_DEFINITIONS = """\
One thing is varied at a time, around a base of {base}; everything else is what the product does by itself.
Everything is judged on the held-out views (every eighth) at {size} pixels, also what was fitted to smaller photographs.
Times are wall seconds of one run after the other; the CSV has processor seconds too.

- *PSNR*: of the scene in the photographs' colours, over the seconds of the geometry.
- *CCPR*: the share of the photographs' contrasts between neighbours that a deutan still sees in the enhanced scene.
- *RWE*: how much its views contradict each other, relative to the photographs (1: as much as these).
- *CCPR × (1 - RWE)*: 0 where RWE > 1, because there more contrast would count against a scene. A scene that comes
  closer to the photographs comes closer to their RWE of 1 too, so this falls with fidelity: read it beside the CCPR.
  These three are over the seconds of everything: enhancement, geometry and colours. `post` enhances every further
  picture anew, which these seconds do not have in them.
- The *front* joins what nothing dominates: no other point is better for no more time."""

Quantity = Callable[[ParetoPoint], float]


def write_pareto(folder: Path, points: Sequence[ParetoPoint], heading: Sequence[str], *, base: str, size: int) -> str:
    """Write ``pareto.csv``, ``pareto.md`` and a chart for each capture; returns the text of the page.

    Args:
        points: of all captures, each with its fronts.
        heading: lines that say how the figures were made.
        base: what is varied, in words.
        size: longer side in pixels of the photographs that results are judged by.
    """
    write_csv(folder / f"{NAME}.csv", ParetoPoint, points)
    captures = list(dict.fromkeys(point.capture for point in points))
    lines = ["# Speed against accuracy", "", *heading, "", _DEFINITIONS.format(base=base, size=size), ""]
    lines += _of_peers(points)
    for capture in captures:
        mine = [point for point in points if point.capture == capture]
        name = NAME if len(captures) == 1 else f"{NAME}-{capture}"
        write_charts(folder, name, _SIZE, partial(_draw, points=mine))
        alternative = f"PSNR, contrast and consistency of {capture} over time; the table below has the same figures"
        lines += [f"## {capture}", "", picture(name, alternative), "", *_defaults(mine), "", *_table(mine), ""]
    text = "\n".join(lines)
    (folder / f"{NAME}.md").write_text(text, encoding="utf-8")
    return text


def _draw(figure: Figure, theme: Theme, points: Sequence[ParetoPoint]) -> None:
    """Four charts with one legend below."""
    axes = figure.subplots(2, 2)
    geometry, everything = attrgetter("geometry_seconds"), attrgetter("seconds")
    panels = [
        (axes[0, 0], geometry, attrgetter("psnr"), "PSNR of held-out views, dB", "seconds of the geometry"),
        (axes[0, 1], everything, attrgetter("score"), "CCPR × (1 - RWE)", "seconds of everything"),
        (axes[1, 0], everything, attrgetter("ccpr"), "CCPR (higher is better)", "seconds of everything"),
        (axes[1, 1], everything, attrgetter("rwe"), "RWE (lower is better)", "seconds of everything"),
    ]
    for panel, x, y, title, x_label in panels:
        panel.set(title=title, xlabel=x_label)
        panel.margins(_MARGIN)
        logarithmic(panel)
        # All enhancers of one mode have the same geometry.
        shown = [p for p in points if p.series != "enhancer"] if panel is axes[0, 0] else points
        _draw_points(panel, theme, shown, x, y)
    _draw_front(axes[0, 0], theme, [(p.geometry_seconds, p.psnr) for p in points if p.leads_psnr])
    _draw_front(axes[0, 1], theme, [(p.seconds, p.score) for p in points if p.leads_score])
    handles: dict[str, Artist] = {}
    for panel in axes.flat:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=5)


def _draw_points(axes: Axes, theme: Theme, points: Sequence[ParetoPoint], x: Quantity, y: Quantity) -> None:
    styles = dict(zip(SERIES, theme.series, strict=False))
    for series, style in styles.items():
        mine = [point for point in points if point.series == series]
        if mine:
            label = _SERIES_NAMES[series]
            plot_series(axes, [x(p) for p in mine], [y(p) for p in mine], style, label, joined=False, alpha=0.9)
    peer = SeriesStyle(theme.ink, theme.series[-1].marker, "none")
    for_peers = [point for point in points if point.series == PEER]
    if for_peers:
        plot_series(axes, [x(p) for p in for_peers], [y(p) for p in for_peers], peer, "other programs", joined=False)
    first = {_program(point): point for point in reversed(for_peers) if not math.isnan(y(point))}
    for name, point in first.items():
        _name(axes, theme, name, (x(point), y(point)))
    ours = [point for point in points if point.series == DEFAULT]
    star = SeriesStyle(theme.background, "*", "none")
    outline = {"markersize": _STAR, "markeredgecolor": theme.ink, "zorder": 4}
    plot_series(axes, [x(p) for p in ours], [y(p) for p in ours], star, "our defaults", joined=False, **outline)
    for point in ours:
        _name(axes, theme, point.label, (x(point), y(point)))


def _name(axes: Axes, theme: Theme, name: str, place: tuple[float, float]) -> None:
    """Write what a point is, below it."""
    below = (0, -7)
    axes.annotate(
        name, place, below, textcoords="offset points", ha="center", va="top", fontsize="small", color=theme.ink
    )


def _program(point: ParetoPoint) -> str:
    """The name of a peer's program, without how it was asked."""
    return point.label.partition(",")[0]


def _draw_front(axes: Axes, theme: Theme, front: Sequence[tuple[float, float]]) -> None:
    if front:
        x, y = zip(*sorted(front), strict=True)
        axes.step(x, y, where="post", color=theme.ink, linewidth=0.8, label="Pareto front", zorder=1)


def _of_peers(points: Sequence[ParetoPoint]) -> list[str]:
    programs = list(dict.fromkeys(_program(point) for point in points if point.series == PEER))
    if not programs:
        return ["No other program was here to be measured beside.", ""]
    return [
        f"Measured in the same call: {', '.join(programs)}. Other programs enhance nothing and are in the first chart "
        "alone. Those that need a GPU, such as gsplat, were not run.",
        "",
    ]


def _defaults(points: Sequence[ParetoPoint]) -> list[str]:
    """For each of our defaults whether something else was better for no more time."""
    lines = []
    for point in (p for p in points if p.series == DEFAULT and not p.error):
        times = f"{number(point.geometry_seconds, 0)} s of geometry, {number(point.seconds, 0)} s of everything"
        quality = f"{number(point.psnr, 2)} dB, CCPR × (1 - RWE) {number(point.score, 3)}"
        lines.append(
            f"- **{point.label}**: {point.iterations:,} steps at {point.size} px, {times}: {quality}. "
            f"{_dominated(point, points)}"
        )
    return lines


def _dominated(point: ParetoPoint, points: Sequence[ParetoPoint]) -> str:
    if point.leads_psnr:
        return "On the PSNR front."
    better = [p for p in points if p.geometry_seconds <= point.geometry_seconds and p.psnr >= point.psnr]
    best = max(better, key=lambda p: p.psnr)
    seconds, gain = number(best.geometry_seconds, 0), number(best.psnr - point.psnr, 2)
    return f"Dominated in PSNR by *{best.label}* ({seconds} s, {gain} dB more)."


def _table(points: Sequence[ParetoPoint]) -> list[str]:
    header = ["varied", "", "px", "SH", "Gaussians", "PSNR", "CCPR", "RWE", "CCPR × (1 - RWE)"]
    header += ["geometry, s", "everything, s", "processor s", "MB", "front"]
    rows = []
    for p in points:
        figures = [number(p.psnr, 2), *(number(value, 3) for value in (p.ccpr, p.rwe, p.score))]
        times = [number(value, 1) for value in (p.geometry_seconds, p.seconds, p.processor_seconds)]
        fronts = [name for name, on in (("PSNR", p.leads_psnr), ("CCPR", p.leads_score)) if on]
        size = [p.label if not p.error else f"{p.label}: {p.error}", str(p.size), str(p.sh_degree), str(p.gaussians)]
        rows.append([p.series, *size, *figures, *times, str(p.peak_memory_mb or "–"), ", ".join(fronts)])
    return markdown_table(header, rows)
