"""What a scene costs as the work grows: seconds, memory and Gaussians over the views and over their pixels.

Command: ``benchmark.py cost``. One thing grows at a time; each trial has a process and the machine to itself.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy import stats

from ....core.intake.sampling import evenly_spread
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ..charts import Theme, logarithmic, picture, plot_series, write_charts
from ..options import Part, add_study_arguments, chosen_sources, made_by, positives, with_quick_defaults, work_folder
from ..provenance import trained_product
from ..tables import Column, frame_of, markdown_table, means_and_deviations, tables_of_means, write_csv, write_text
from .captures import DEMO, CaptureFolder, Subject
from .jobs import Job, run_jobs
from .recipe import Recipe, Trial, failures, optimistic, with_derived

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "cost"
SIZE, ITERATIONS = 240, 800
VIEWS = (12, 25, 50, 100, 200, 400)
SIZES = (120, 240, 360, 480, 720, 960)
QUICK_VIEWS, QUICK_SIZES = (10, 20, 40), (80, 100, 120)
CONFIDENCE = 0.95
OVER = {"views": "photographs", "pixels": "pixels of a photograph"}
"""What grows, with its name in tables and charts."""

_PANEL, _HEIGHT = 4.2, 7.5  # inches
_LEAST_RATIO = 1.2  # of two numbers below a chart
_LEAST_RANGE = 10.0  # of a y axis, its top by its bottom
_FIGURES: tuple[Column, ...] = (
    ("geometry_seconds", "geometry, s", ".1f"),
    ("enhance_seconds", "enhancement, s", ".1f"),
    ("layer_seconds", "colours, s", ".1f"),
    ("processor_seconds", "processor seconds", ".1f"),
    ("peak_memory_mb", "MB", ".0f"),
    ("gaussians", "Gaussians", ".0f"),
)
_QUALITY: Column = ("psnr", "PSNR", ".2f")
_DRAWN = {
    "processor_seconds": "processor seconds of everything",
    "peak_memory_mb": "peak memory, MB",
    "gaussians": "Gaussians",
}
_EXPONENTS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("over", "over", ""),
    ("figure", "of", ""),
    ("exponent", "exponent", ".2f"),
    ("low", "from", ".2f"),
    ("high", "to", ".2f"),
    ("points", "points", "d"),
)
_DEFINITIONS = """\
One thing grows at a time, everything else is the product's own. Views are spread evenly over the capture, up to all
that it has; pixels are those of one photograph, up to its own. Each trial has a process to itself, so memory is the
peak of that trial; the parts' seconds are by the clock, processor seconds are of all threads and all parts. A cost that
grows as a power of the work is a line where both axes are logarithmic; its *exponent* is the slope (1: twice the work
costs twice as much; 0: no more), fitted by least squares to the means over seeds, *from* and *to* its {confidence:.0f}
% interval by Student's t. The number of steps is fixed, as it is in a run, so the geometry's time does not follow the
views."""


@dataclass(frozen=True)
class SomeViews:
    """A part of a capture.

    Attributes:
        base: the whole capture.
        count: number of views, spread evenly; all of them if there are no more.
    """

    base: CaptureFolder
    count: int

    @property
    def name(self) -> str:
        return self.base.name

    @property
    def key(self) -> str:
        return repr((self.base.key, self.count))

    def load(self) -> Subject:
        """Read it."""
        whole = self.base.load().given
        return Subject.of(replace(whole, views=tuple(evenly_spread(whole.views, self.count))))


def measure_cost(
    sources: Sequence[CaptureFolder],
    recipe: Recipe,
    views: Sequence[int],
    sizes: Sequence[int],
    seeds: int,
    folder: Path,
    reporter: Reporter,
    *,
    again: bool = False,
) -> pd.DataFrame:
    """One trial of the recipe for each capture, number of views, size and seed.

    Returns:
        Columns of `Trial` and of `with_derived`, ``over`` (a key of `OVER`) and ``amount``, of views or pixels.
    """
    asked: list[tuple[str, int, Job]] = []
    for source in sources:
        counts, pixels = there_are(source, views, sizes)
        for seed in range(seeds):
            seeded = (replace(recipe, seed=seed),)
            asked += [("views", count, Job(SomeViews(source, count), seeded)) for count in counts]
            asked += [("pixels", area, Job(replace(source, max_size=size), seeded)) for size, area in pixels.items()]
    trials = frame_of(Trial, run_jobs([job for _, _, job in asked], folder, reporter, again=again))
    trials = trials.assign(over=[over for over, _, _ in asked], amount=[amount for _, amount, _ in asked])
    return with_derived(trials)


def there_are(source: CaptureFolder, views: Sequence[int], sizes: Sequence[int]) -> tuple[list[int], dict[int, int]]:
    """The numbers of views that a capture has, and the pixels of a photograph by the sizes that it has."""
    whole = replace(source, max_size=max(sizes)).load().given.views
    camera = whole[0].camera
    longer, area = max(camera.width, camera.height), camera.width * camera.height
    counts = sorted({min(count, len(whole)) for count in views})
    return counts, {size: round(area * (size / longer) ** 2) for size in sorted({min(size, longer) for size in sizes})}


def exponents(trials: pd.DataFrame) -> pd.DataFrame:
    """How each figure grows with the work.

    Through the geometric means over seeds, since what keeps a cost from being a power of the work is the same for all.

    Args:
        trials: as `measure_cost` returns them.

    Returns:
        ``capture``, ``over``, ``figure``; ``exponent``, ``low`` and ``high`` as of `power_law`; ``points``.
    """
    rows: list[dict[str, Any]] = []
    for (capture, over), mine in trials[trials.error == ""].groupby(["capture", "over"], sort=False):
        for name, title, _ in _FIGURES:
            known = mine[mine[name] > 0.0].groupby("amount")[name].apply(stats.gmean)
            exponent, low, high = power_law(known.index, known)
            fitted = {"exponent": exponent, "low": low, "high": high, "points": len(known)}
            rows.append({"capture": capture, "over": OVER[str(over)], "figure": title.partition(",")[0], **fitted})
    return pd.DataFrame(rows, columns=[name for name, _, _ in _EXPONENTS])


def power_law(amounts: Sequence[float], costs: Sequence[float]) -> tuple[float, float, float]:
    """The exponent of cost = a · amount^exponent and the ends of its interval of `CONFIDENCE`.

    By least squares between logarithms; NaN where the amounts do not differ, and for the ends with fewer than three
    points.
    """
    x, y = np.log(np.asarray(amounts, float)), np.log(np.asarray(costs, float))
    if len(set(x)) < 2:
        return np.nan, np.nan, np.nan
    fit = stats.linregress(x, y)
    if len(x) < 3:
        return fit.slope, np.nan, np.nan
    reach = stats.t.ppf(0.5 + CONFIDENCE / 2.0, len(x) - 2) * fit.stderr
    return fit.slope, fit.slope - reach, fit.slope + reach


def write_cost(folder: Path, trials: pd.DataFrame, heading: Sequence[str]) -> str:
    """Write ``cost.csv``, ``cost.md`` and its chart; returns the text of the page."""
    write_csv(folder / f"{NAME}.csv", trials)
    found = exponents(trials)
    size = (_PANEL * len(OVER), _HEIGHT)
    write_charts(folder, NAME, size, partial(_draw, trials=trials[trials.error == ""]))
    alternative = (
        "Seconds, memory and Gaussians over the photographs and their pixels; the tables have the same figures"
    )
    definitions = _DEFINITIONS.format(confidence=100.0 * CONFIDENCE)
    of_work = [f"{trial.capture}, {trial.amount:,} {OVER[trial.over]}" for trial in trials.itertuples()]
    lines = ["# Cost as work grows", "", *heading, "", definitions, "", *optimistic(trials.assign(capture=of_work))]
    lines += [picture(NAME, alternative), ""]
    lines += ["## Exponents", "", *markdown_table(found, _EXPONENTS), ""]
    for (capture, over), mine in trials.groupby(["capture", "over"], sort=False):
        means, deviations = means_and_deviations(mine, ["amount"], (*_FIGURES, _QUALITY))
        keys = (("amount", OVER[str(over)], "d"),)
        lines += [f"## {capture}: {OVER[str(over)]}", ""]
        lines += [*tables_of_means(means, deviations, keys, (*_FIGURES, _QUALITY)), ""]
    return write_text(folder / f"{NAME}.md", [*lines, *failures(trials)])


def _draw(figure: Figure, theme: Theme, trials: pd.DataFrame) -> None:
    """A column for what grows, a row for each figure, a series for each capture."""
    axes = figure.subplots(len(_DRAWN), len(OVER), sharex="col", sharey="row", squeeze=False)
    captures = list(dict.fromkeys(trials.capture))
    for column, (over, title) in enumerate(OVER.items()):
        for row, (name, what) in enumerate(_DRAWN.items()):
            panel = axes[row, column]
            panel.set_title(what)
            logarithmic(panel)
            for capture, style in zip(captures, theme.series, strict=False):
                mine = trials[(trials.capture == capture) & (trials.over == over)]
                means = mine.groupby("amount")[name].mean()
                plot_series(panel, means.index, means, style, capture)
        shown = _apart(trials.amount[trials.over == over])
        axes[-1, column].set_xticks(shown, [f"{amount / 1000:.0f}k" if amount > 9999 else amount for amount in shown])
        axes[-1, column].set_xlabel(title)
    for panel in axes[:, 0]:
        _plain_and_wide(panel)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


def _apart(amounts: Sequence[float]) -> list[float]:
    """The amounts from the smallest on, without those that are too close to another to be written beside it."""
    shown: list[float] = []
    for amount in sorted(set(amounts)):
        if not shown or amount >= _LEAST_RATIO * shown[-1]:
            shown.append(amount)
    return shown


def _plain_and_wide(panel: Axes) -> None:
    """A logarithmic y axis with plain numbers, wide enough that what hardly grows looks like that."""
    from matplotlib.ticker import LogLocator, NullLocator

    panel.set_yscale("log")
    low, high = panel.get_ylim()
    wider = max((_LEAST_RANGE / (high / low)) ** 0.5, 1.0)
    panel.set_ylim(low / wider, high * wider)
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_major_formatter("{x:,g}")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    # One process: times and memory are those of trials that have the machine to themselves.
    add_study_arguments(parser, captures=(DEMO,), max_size=SIZE, iterations=ITERATIONS, alone=True)
    add, shown = parser.add_argument, (",".join(map(str, some)) for some in (VIEWS, SIZES))
    add("--views", type=positives, default=VIEWS, metavar="N,M", help=f"numbers of views ({next(shown)})")
    add("--sizes", type=positives, default=SIZES, metavar="N,M", help=f"longer sides in pixels ({next(shown)})")


def _measure(options: argparse.Namespace) -> str:
    """Make scenes of more and more views and pixels; writes cost.csv, cost.md and a chart."""
    options = with_quick_defaults(options)
    views, sizes = (QUICK_VIEWS, QUICK_SIZES) if options.quick else (options.views, options.sizes)
    recipe, reporter = Recipe(NAME, iterations=options.iterations), ConsoleReporter(sys.stderr)
    asked = (chosen_sources(options), recipe, views, sizes, options.seeds, work_folder(options), reporter)
    trials = measure_cost(*asked, again=options.again)
    grown = ", ".join(map(str, sorted(set(sizes))))
    what = f"Views of at most {options.max_size} pixels where their number grows, {grown} pixels where their size does"
    return write_cost(options.out, trials, made_by(options, trials, views=what))


PART = Part(
    NAME,
    "seconds, memory and Gaussians over views and pixels, with exponents",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md",),
    shaped_by=lambda: (*trained_product(), Recipe("any")),
)
