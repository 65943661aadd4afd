"""Speed against accuracy: what recipes of many lengths and sizes cost and give, and which of them nothing dominates.

Command: ``benchmark.py pareto``, which also measures other programs (see `peers`).
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ....core.errors import InputError
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.settings import QUALITIES, Settings
from ..charts import SeriesStyle, Theme, logarithmic, picture, plot_series, plot_stars, write_charts
from ..enhancers.methods import GAIN, LUT, NETWORK, NONE, PER_VIEW_LUT
from ..options import Part, add_study_arguments, chosen_sources, names, trials_took, with_quick_defaults, work_folder
from ..provenance import predicting_weights, trained_product
from ..tables import Column, frame_of, markdown_table, number, write_csv, write_text
from .captures import DEMO, CaptureFolder
from .jobs import Job, run_jobs
from .peers import opensplat_runs, train_opensplat
from .recipe import Recipe, Trial, optimistic, with_derived

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "pareto"
SIZE, BASE_STEPS = 480, 600
DEFAULT, PEER = "default", "peer"
SERIES = {
    "steps": "steps of training",
    "photographs": "smaller photographs",
    "limit": "fixed number of Gaussians",
    "SH degree": "SH degree",
    "mode": "mode",
    "enhancer": "enhancer",
}
"""What is varied, with its name in the legend; everything else is then the product's."""
_UNLIMITED = 640  # pixels of a run with automatic size on the processor
DEFAULTS = {
    **{quality.label.lower(): (quality.iterations, quality.max_size) for quality in QUALITIES},
    "run.py": (Settings.iterations, _UNLIMITED),
}
"""Steps and size of photographs of the product's own choices."""

_STEPS = (1 / 3, 2 / 3, 4 / 3, 8 / 3)  # of the base, at full size
_SMALLER = {2 / 3: (1, 2), 1 / 2: (0.5, 1, 2), 1 / 3: (1,)}  # size of the photographs: steps, of the base
_BASE_SIZE = 2 / 3
_LIMITS = (2500, 5000, 10_000, 20_000)
_DEGREES = (1, 3)
_ENHANCERS = (NONE, GAIN, LUT, NETWORK, PER_VIEW_LUT)
_STEPS_ROUNDED_TO = 10

_CHART_SIZE = (10.0, 7.6)  # inches
_MARGIN = 0.08  # around the points, in widths and heights of a chart: their names are written there
_DEFINITIONS = """\
One thing is varied at a time, around a base of {base}; everything else is what the product does by itself.
Everything is judged on the held-out views (every eighth) at {size} pixels, also what was fitted to smaller photographs.
Times are wall seconds of {runs}; the CSV has processor seconds too.

- *PSNR*: of the scene in the photographs' colours, over the seconds of the geometry.
- *CCPR*: the share of the photographs' contrasts between neighbours that a deutan still sees in the enhanced scene.
- *RWE*: how much its views contradict each other, relative to the photographs (1: as much as these).
- *CCPR × (1 - RWE)*: 0 where RWE > 1, because there more contrast would count against a scene. A scene that comes
  closer to the photographs comes closer to their RWE of 1 too, so this falls with fidelity: read it beside the CCPR.
  These three are over the seconds of everything: enhancement, geometry and colours. `post` enhances every further
  picture anew, which these seconds do not have in them.
- The *front* joins what nothing dominates: no other point is better for no more time."""
_COLUMNS: tuple[Column, ...] = (
    ("series", "varied", ""),
    ("label", "", ""),
    ("size", "px", "d"),
    ("sh_degree", "SH", ".2g"),
    ("gaussians", "Gaussians", ".0f"),
    ("psnr", "PSNR", ".2f"),
    ("psnr_deviation", "±", ".2f"),
    ("ccpr", "CCPR", ".3f"),
    ("rwe", "RWE", ".3f"),
    ("score", "CCPR × (1 - RWE)", ".3f"),
    ("geometry_seconds", "geometry, s", ".1f"),
    ("seconds", "everything, s", ".1f"),
    ("processor_seconds", "processor s", ".1f"),
    ("peak_memory_mb", "MB", ".0f"),
    ("front", "front", ""),
)
_WITHOUT_DEVIATION = tuple(column for column in _COLUMNS if column[0] != "psnr_deviation")
_SAVED = (
    *("capture", "series", "label", "mode", "enhancer", "size", "iterations", "seed", "gaussians", "sh_degree"),
    *("psnr", "ccpr", "rwe", "score", "geometry_seconds", "seconds", "processor_seconds", "peak_memory_mb"),
    "error",
)


@dataclass(frozen=True)
class Variant:
    """A recipe, what it varies, and the longer side of the photographs that it is fitted to."""

    series: str
    recipe: Recipe
    fitted_size: int


def variants(size: int, base_steps: int, defaults: Sequence[str], seed: int = 0) -> list[Variant]:
    """All choices, varied one at a time around the base, and the product's defaults.

    Args:
        size: longer side of the photographs that results are judged by.
        base_steps: of the base, which has photographs of two thirds that size.
        defaults: names of `DEFAULTS`.
    """
    base_size = round(_BASE_SIZE * size)

    def variant(series: str, label: str, fitted_size: int = base_size, **choices: Any) -> Variant:
        return Variant(series, Recipe(label, seed=seed, **{"iterations": base_steps, **choices}), fitted_size)

    found = []
    for factor in _STEPS:
        steps = _rounded(factor * base_steps)
        found.append(variant("steps", f"{steps:,} steps", size, iterations=steps))
    for share, factors in _SMALLER.items():
        for factor in factors:
            steps, smaller = _rounded(factor * base_steps), round(share * size)
            found.append(variant("photographs", f"{steps:,} steps at {smaller} px", smaller, iterations=steps))
    found += [variant("limit", f"at most {limit:,} Gaussians", gaussians=limit) for limit in _LIMITS]
    found += [variant("SH degree", f"SH degree {degree}", sh_degree=degree) for degree in _DEGREES]
    found += [variant("mode", f"mode {mode}", mode=mode) for mode in ("joint", "post")]
    found += [variant("enhancer", f"enhancer {name}", enhancer=name) for name in _ENHANCERS]
    for name in defaults:
        steps, max_size = DEFAULTS[name]
        found.append(variant(DEFAULT, name, min(max_size, size), iterations=steps, sh_degree=None))
    return found


def few_variants(size: int, base_steps: int, defaults: Sequence[str], seed: int = 0) -> list[Variant]:
    """Enough of `variants` for a smoke test; all at one size, so that they share a process."""
    base = Recipe("base", iterations=base_steps, seed=seed)
    found = [
        Variant("steps", replace(base, label="half the steps", iterations=base_steps // 2), size),
        Variant("steps", replace(base, label="a short run"), size),
        Variant("mode", replace(base, label="mode post", mode="post"), size),
        Variant("enhancer", replace(base, label=f"enhancer {NONE}", enhancer=NONE), size),
    ]
    return [*found, *(Variant(DEFAULT, replace(base, label=name), size) for name in defaults[:1])]


def _rounded(steps: float) -> int:
    return max(round(steps / _STEPS_ROUNDED_TO) * _STEPS_ROUNDED_TO, _STEPS_ROUNDED_TO)


def measure_variants(
    source: CaptureFolder,
    tried: Sequence[Variant],
    folder: Path,
    reporter: Reporter,
    *,
    processes: int = 1,
    again: bool = False,
) -> pd.DataFrame:
    """The points of all variants on a capture; those with the same photographs and seed share their common work."""
    groups: dict[tuple[int, int], list[Variant]] = {}
    for variant in tried:
        groups.setdefault((variant.fitted_size, variant.recipe.seed), []).append(variant)
    jobs = [
        Job(replace(source, fitted_size=size), tuple(variant.recipe for variant in group))
        for (size, _), group in groups.items()
    ]
    trials = run_jobs(jobs, folder, reporter, processes=processes, again=again)
    listed = [variant for group in groups.values() for variant in group]
    return points_of(trials, [variant.series for variant in listed], [variant.fitted_size for variant in listed])


def points_of(trials: Sequence[Trial], series: Sequence[str], sizes: Sequence[int]) -> pd.DataFrame:
    """A frame of trials with their ``series``, ``size`` of the fitted photographs, ``seconds`` and ``score``."""
    points = with_derived(frame_of(Trial, trials)).assign(series=series, size=sizes)
    return points.assign(score=[consistent_contrast(*pair) for pair in zip(points.ccpr, points.rwe, strict=True)])


def consistent_contrast(ccpr: float, rwe: float) -> float:
    """CCPR × (1 - RWE), and 0 where RWE > 1: there more contrast would make it worse, which says nothing."""
    return ccpr * max(1.0 - rwe, 0.0) if not math.isnan(rwe) else math.nan


def means_over_seeds(points: pd.DataFrame) -> pd.DataFrame:
    """One point for each variant of one capture: the means of its seeds that gave a scene.

    Returns:
        The columns of `points` except ``seed``, and ``psnr_deviation``, the sample standard deviation of the PSNR; NaN
        of a variant with fewer than two scenes. ``error`` has those of all seeds.
    """
    by = ["capture", "series", "label", "size", "iterations"]
    figures = points.select_dtypes("number").columns.difference([*by, "seed"])
    words = points.columns.difference([*by, *figures, "seed", "error"])
    groups = points.groupby(by, sort=False)
    means = groups.agg({**dict.fromkeys(figures, "mean"), **dict.fromkeys(words, "first"), "error": _distinct})
    return means.assign(psnr_deviation=groups.psnr.std()).reset_index()


def _distinct(errors: Sequence[str]) -> str:
    return "; ".join(dict.fromkeys(error for error in errors if error))


def with_fronts(points: pd.DataFrame) -> pd.DataFrame:
    """The points of one capture by the cost of their geometry, with ``leads_psnr`` and ``leads_score``.

    A point leads in PSNR if no other has more for no more ``geometry_seconds``, and in score if none has more for no
    more ``seconds``.
    """
    points = points.reset_index(drop=True)
    leads_psnr = points.index.isin(pareto_front(points.geometry_seconds, points.psnr))
    leads_score = points.index.isin(pareto_front(points.seconds, points.score))
    return points.assign(leads_psnr=leads_psnr, leads_score=leads_score).sort_values("geometry_seconds", kind="stable")


def pareto_front(costs: Sequence[float], values: Sequence[float]) -> list[int]:
    """Positions of the points that nothing dominates, the cheapest first.

    A point dominates another if it costs no more and is worth no less, and one of the two is better. Points with a NaN
    take no part. Of equal points all or none are returned.
    """
    points = pd.DataFrame({"cost": list(costs), "value": list(values)}, dtype=float).dropna()
    points = points.sort_values(["cost", "value"], ascending=[True, False])
    leads = points.value == points.value.cummax()
    return points.index[leads & (points.cost == points.groupby("value").cost.transform("min"))].tolist()


def write_pareto(folder: Path, points: pd.DataFrame, *, base: str, size: int, processes: int = 1) -> str:
    """Write ``pareto.csv``, ``pareto.md`` and a chart for each capture; returns the text of the page.

    Args:
        points: of all captures and seeds.
        base: what is varied, in words.
        size: longer side in pixels of the photographs that results are judged by.
        processes: how many trials ran at a time.
    """
    write_csv(folder / f"{NAME}.csv", points.fillna({"gaussians": 0, "peak_memory_mb": 0})[list(_SAVED)])
    took = trials_took(points[points.series != PEER], processes)
    runs = "one run after the other" if processes == 1 else f"runs, up to {processes} of them at a time"
    lines = ["# Speed against accuracy", "", took, "", _DEFINITIONS.format(base=base, size=size, runs=runs), ""]
    seeds, repeated = points.seed.nunique(), points.seed.nunique() > 1
    if repeated:
        lines += [f"Points are the means of {seeds} seeds, ± the sample standard deviation; the CSV has every run.", ""]
    lines += [*optimistic(points), *_of_peers(points)]
    captures = points.groupby("capture", sort=False)
    for capture, runs in captures:
        mine = with_fronts(means_over_seeds(runs))
        name = NAME if len(captures) == 1 else f"{NAME}-{capture}"
        write_charts(folder, name, _CHART_SIZE, partial(_draw, points=mine))
        alternative = f"PSNR, contrast and consistency of {capture} over time; the table below has the same figures"
        lines += [f"## {capture}", "", picture(name, alternative), "", *_defaults(mine), ""]
        fronts = mine.leads_psnr.map({True: "PSNR ", False: ""}) + mine.leads_score.map({True: "CCPR", False: ""})
        # Without the size, which has a column of its own.
        labels = mine.label.str.split(" at ").str[0] + mine.error.map(lambda error: f": {error}" if error else "")
        shown = mine.assign(label=labels, front=fronts.str.split().str.join(", "))
        lines += [*markdown_table(shown, _COLUMNS if repeated else _WITHOUT_DEVIATION), ""]
    return write_text(folder / f"{NAME}.md", lines)


def _draw(figure: Figure, theme: Theme, points: pd.DataFrame) -> None:
    """Four charts with one legend below."""
    axes = figure.subplots(2, 2)
    panels = [
        (axes[0, 0], "geometry_seconds", "psnr", "PSNR of held-out views, dB", "seconds of the geometry"),
        (axes[0, 1], "seconds", "score", "CCPR × (1 - RWE)", "seconds of everything"),
        (axes[1, 0], "seconds", "ccpr", "CCPR (higher is better)", "seconds of everything"),
        (axes[1, 1], "seconds", "rwe", "RWE (lower is better)", "seconds of everything"),
    ]
    for panel, x, y, title, x_label in panels:
        panel.set(title=title, xlabel=x_label)
        panel.margins(_MARGIN)
        logarithmic(panel)
        # All enhancers of one mode have the same geometry.
        _draw_points(panel, theme, points[points.series != "enhancer"] if panel is axes[0, 0] else points, x, y)
    for panel, x, y, leads in ((*panels[0][:3], "leads_psnr"), (*panels[1][:3], "leads_score")):
        front = points[points[leads]].sort_values([x, y])
        if not front.empty:
            label = "Pareto front"
            panel.step(front[x], front[y], where="post", color=theme.ink, linewidth=0.8, label=label, zorder=1)
    handles: dict[str, Artist] = {}
    for panel in axes.flat:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=5)


def _draw_points(axes: Axes, theme: Theme, points: pd.DataFrame, x: str, y: str) -> None:
    legend = {**SERIES, PEER: "other programs"}
    peer = SeriesStyle(theme.ink, theme.series[-1].marker, "")
    styles = {**dict(zip(SERIES, theme.series, strict=False)), PEER: peer}
    for series, mine in ((series, points[points.series == series]) for series in legend):
        if not mine.empty:
            opacity = {} if series == PEER else {"alpha": 0.9}
            plot_series(axes, mine[x], mine[y], styles[series], legend[series], joined=False, **opacity)
    peers = points[(points.series == PEER) & points[y].notna()]
    ours = points[points.series == DEFAULT]
    plot_stars(axes, ours[x], ours[y], theme, "our defaults")
    named = [*zip(_programs(peers), peers[x], peers[y], strict=True)][::-1]
    first = {program: (x, y) for program, x, y in named}
    for name, place in [*first.items(), *zip(ours.label, zip(ours[x], ours[y], strict=True), strict=True)]:
        below = (0, -7)
        label = axes.annotate(
            name, place, below, textcoords="offset points", ha="center", va="top", fontsize="small", color=theme.ink
        )
        label.set_zorder(1.5)  # over the front's line, under the points
        label.set_bbox({"boxstyle": "square,pad=0.05", "facecolor": theme.background, "edgecolor": "none"})


def _programs(peers: pd.DataFrame) -> list[str]:
    """The names of peers' programs, without how they were run."""
    return [label.partition(",")[0] for label in peers.label]


def _of_peers(points: pd.DataFrame) -> list[str]:
    programs = list(dict.fromkeys(_programs(points[points.series == PEER])))
    if not programs:
        return ["No other program was measured.", ""]
    return [
        f"Measured in the same call: {', '.join(programs)}. Other programs enhance nothing and are in the first chart "
        "alone. Those that need a GPU, such as gsplat, were not run.",
        "",
    ]


def _defaults(points: pd.DataFrame) -> list[str]:
    """For each of our defaults, whether something else was better for no more time."""
    lines = []
    for point in points[(points.series == DEFAULT) & (points.error == "")].itertuples():
        verdict = "On the PSNR front."
        if not point.leads_psnr:
            better = points[(points.geometry_seconds <= point.geometry_seconds) & (points.psnr >= point.psnr)]
            best = better.loc[better.psnr.idxmax()]
            gain = f"{best.psnr - point.psnr:.2f} dB more"
            verdict = f"Dominated in PSNR by *{best.label}* ({best.geometry_seconds:.0f} s, {gain})."
        times = f"{point.geometry_seconds:.0f} s of geometry, {number(point.seconds, '.0f')} s of everything"
        quality = f"{point.psnr:.2f} dB, CCPR × (1 - RWE) {number(point.score, '.3f')}"
        run = f"{point.iterations:,} steps at {point.size} px"
        lines.append(f"- **{point.label}**: {run}, {times}: {quality}. {verdict}")
    return lines


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    # One process: times are those of runs that have the machine to themselves.
    add_study_arguments(parser, captures=(DEMO,), max_size=SIZE, iterations=BASE_STEPS, processes=1)
    usual = tuple(quality.label.lower() for quality in QUALITIES)
    what = f"of {', '.join(DEFAULTS)}, none ({','.join(usual)})"
    parser.add_argument("--defaults", type=names, default=usual, metavar="A,B", help=what)
    parser.add_argument("--opensplat", type=Path, metavar="FILE", help="OpenSplat's executable, to compare with")


def _measure(options: argparse.Namespace) -> str:
    """Try recipes of many lengths and sizes on captures; writes pareto.csv, pareto.md and charts."""
    options = with_quick_defaults(options)
    reporter, work = ConsoleReporter(sys.stderr), work_folder(options)
    defaults = () if tuple(options.defaults) == ("none",) else options.defaults
    if unknown := set(defaults) - set(DEFAULTS):
        raise InputError(f"no default '{min(unknown)}'", where="--defaults", remedy=f"use none, {', '.join(DEFAULTS)}")
    choose = few_variants if options.quick else variants
    points = []
    for source in chosen_sources(options):
        seeds = (choose(options.max_size, options.iterations, defaults, seed) for seed in range(options.seeds))
        tried = [variant for some in seeds for variant in some]
        mine = measure_variants(source, tried, work, reporter, processes=options.processes, again=options.again)
        if options.opensplat and not options.quick:
            peers = train_opensplat(options.opensplat, source.name, source.load(), reporter, opensplat_runs())
            trials = [peer.trial for peer in peers]
            mine = pd.concat([mine, points_of(trials, [PEER] * len(trials), [options.max_size] * len(trials))])
        points.append(mine)
    size = "the judged size" if options.quick else "two thirds the judged size"
    base = f"{options.iterations:,} steps on photographs of {size}"
    how = {"base": base, "size": options.max_size, "processes": options.processes}
    return write_pareto(options.out, pd.concat(points), **how)


PART = Part(
    NAME,
    "speed against accuracy: a chart with its Pareto front, and other programs",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md",),
    shaped_by=lambda: (
        *(*trained_product(), predicting_weights(), Recipe("any"), DEFAULTS),
        *(_STEPS, _SMALLER, _BASE_SIZE, _LIMITS, _DEGREES, _ENHANCERS),
    ),
)
