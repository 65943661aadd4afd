"""The chart, the table and the page of how many Gaussians scenes need."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..charts import SeriesStyle, Theme, logarithmic, picture, plot_series, write_charts
from ..tables import markdown_table, number, write_csv
from .budget import BudgetRun, Verdict, judge
from .knee import ALLOWED, TOLERANCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "budget"
_PANEL_WIDTH, _HEIGHT = 4.0, 7.2  # inches
_STAR = 11  # points
_FIGURES = (("psnr", "PSNR of held-out views, dB"), ("rwe", "RWE (lower is better)"), ("ccpr", "CCPR"))
_DEFINITIONS = f"""\
Each capture is trained once with the number of Gaussians decided automatically, and then with fixed limits from a
quarter to four times of what that took; everything else is the same. Defined beforehand:

- The *plateau* is the best PSNR of held-out views (every eighth) of all fixed limits.
- The *knee* is the fewest Gaussians that come within {TOLERANCE:g} dB of the plateau, interpolated between runs in the
  logarithm of the number. Where even the smallest run does, it is an upper bound.
- *Auto* should be within {TOLERANCE:g} dB of the plateau with at most {ALLOWED:g} times the knee's Gaussians.
- *Half* and *twice* are what half and twice auto's Gaussians gave, interpolated in the same way.

PSNR scatters between runs that differ in the number of Gaussians alone, and the plateau is the best of several such
runs: auto is held to a line that is a little too high."""


def write_budget(folder: Path, runs: Sequence[BudgetRun], heading: Sequence[str]) -> str:
    """Write ``budget.csv``, ``budget.md`` and its chart; returns the text of the page.

    Args:
        heading: lines that say how the figures were made.
    """
    write_csv(folder / f"{NAME}.csv", BudgetRun, runs)
    verdicts = judge(runs)
    lines = ["# How many Gaussians a scene needs", "", *heading, "", _DEFINITIONS, ""]
    if verdicts:
        size = (_PANEL_WIDTH * len(verdicts), _HEIGHT)
        write_charts(folder, NAME, size, partial(_draw, runs=runs, verdicts=verdicts))
        alternative = "PSNR, RWE and CCPR over the number of Gaussians; the tables below have the same figures"
        lines += [picture(NAME, alternative), "", *_verdict_table(verdicts), "", *_in_words(verdicts), ""]
    lines += ["## All runs", "", *_run_table(runs), ""]
    text = "\n".join(lines)
    (folder / f"{NAME}.md").write_text(text, encoding="utf-8")
    return text


def _draw(figure: Figure, theme: Theme, runs: Sequence[BudgetRun], verdicts: Sequence[Verdict]) -> None:
    """A column for each capture, a row for each figure, one legend below."""
    axes = figure.subplots(len(_FIGURES), len(verdicts), sharex="col", squeeze=False)
    for column, verdict in enumerate(verdicts):
        mine = [run for run in runs if run.capture == verdict.capture and not run.error]
        fixed, auto = [run for run in mine if run.limit], [run for run in mine if not run.limit]
        for row, (name, title) in enumerate(_FIGURES):
            panel = axes[row, column]
            panel.set_title(title if row else f"{verdict.capture}: {title}")
            logarithmic(panel)
            style = theme.series[row]
            sizes, values = [run.gaussians for run in fixed], [getattr(run, name) for run in fixed]
            plot_series(panel, sizes, values, style, "fixed limits")
            star = SeriesStyle(theme.background, "*", "none")
            outline = {"markersize": _STAR, "markeredgecolor": theme.ink, "zorder": 4}
            values = [getattr(run, name) for run in auto]
            plot_series(panel, [run.gaussians for run in auto], values, star, "auto", joined=False, **outline)
            panel.axvline(verdict.knee, color=theme.muted, linewidth=0.9, linestyle="dotted", label="knee")
            if name == "psnr":
                level = verdict.plateau - TOLERANCE
                words = f"{TOLERANCE:g} dB below the plateau"
                panel.axhline(level, color=theme.muted, linewidth=0.9, linestyle="dashed", label=words)
        axes[-1, column].set_xlabel("Gaussians")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 * min(len(verdicts), 2))


def _verdict_table(verdicts: Sequence[Verdict]) -> list[str]:
    header = [
        "capture",
        "plateau, dB",
        "knee",
        "auto",
        "auto / knee",
        "auto, dB",
        "behind, dB",
        "half, dB",
        "twice, dB",
    ]
    rows = []
    for v in verdicts:
        sizes = [number(v.knee, 0), str(v.gaussians), number(v.times_knee, 2)]
        rows.append(
            [v.capture, number(v.plateau, 2), *sizes, *(number(x, 2) for x in (v.psnr, v.behind, v.half, v.twice))]
        )
    return markdown_table(header, rows)


def _in_words(verdicts: Sequence[Verdict]) -> list[str]:
    """What the target says of each capture, and what the automatic decision said itself."""
    lines = []
    for v in verdicts:
        quality = "on the plateau" if v.reaches_plateau else f"{number(v.behind, 2)} dB below the plateau"
        size = f"{number(v.times_knee, 2)} times the knee's Gaussians"
        reached = "reached" if v.reaches_plateau and v.is_lean else "missed"
        lines.append(f"- **{v.capture}**: target {reached}: auto is {quality} with {size}. It said: {v.decision}.")
    return lines


def _run_table(runs: Sequence[BudgetRun]) -> list[str]:
    header = ["capture", "limit", "Gaussians", "PSNR", "CCPR", "RWE", "geometry, s", "processor s", "MB"]
    rows = []
    for run in runs:
        limit = f"{run.limit}" if run.limit else "auto"
        figures = [number(run.psnr, 2), number(run.ccpr, 3), number(run.rwe, 3)]
        times = [number(run.geometry_seconds, 1), number(run.processor_seconds, 1)]
        capture = run.capture if not run.error else f"{run.capture}: {run.error}"
        rows.append([capture, limit, str(run.gaussians), *figures, *times, str(run.peak_memory_mb or "–")])
    return markdown_table(header, rows)
