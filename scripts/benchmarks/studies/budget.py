"""How many Gaussians a scene needs, and how many the automatic decision takes.

Command: ``benchmark.py budget``. Each capture is trained automatically, and then with fixed numbers of Gaussians around
the automatic one; the knee is where more of them stop paying.
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

from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ..charts import Theme, logarithmic, picture, plot_series, plot_stars, write_charts
from ..options import Part, add_study_arguments, chosen_sources, made_by, with_quick_defaults, work_folder
from ..provenance import trained_product
from ..tables import (
    Column,
    frame_of,
    markdown_table,
    means_and_deviations,
    tables_of_means,
    write_csv,
    write_text,
)
from ..timing.runs import at_quality
from .captures import CaptureFolder
from .jobs import Job, run_jobs
from .recipe import Recipe, Trial, optimistic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "budget"
SIZE, ITERATIONS, SEEDS = 240, 800, 3
HALF_DOUBLINGS = (-4, -2, -1, 0, 1, 2, 4)
"""Fixed numbers of Gaussians, in half doublings of the automatic number: a quarter to four times; closer around the
expected knee."""
FEW_HALF_DOUBLINGS = (-2, 0, 2)
TOLERANCE = 0.1
"""dB below the plateau that still count as being on it."""
ALLOWED = 1.3
"""Times the knee's Gaussians that a good decision may take."""

_PANEL_WIDTH, _HEIGHT = 4.0, 7.2  # inches
_FIGURES = (("psnr", "PSNR of held-out views, dB"), ("rwe", "RWE (lower is better)"), ("ccpr", "CCPR"))
_DEFINITIONS = f"""\
Each capture is trained with the number of Gaussians decided automatically, and then with fixed
limits{{range}}; everything else is the same, the seed too. A line of the first table has
the means over the seeds, each judged by its own runs. Defined beforehand:

- The *plateau* is the best PSNR of held-out views (every eighth) of all fixed limits.
- The *knee* is the fewest Gaussians that come within {TOLERANCE:g} dB of the plateau, interpolated between runs in the
  logarithm of the number. Where even the smallest run does, it is an upper bound.
- *Auto* should be within {TOLERANCE:g} dB of the plateau with at most {ALLOWED:g} times the knee's Gaussians.
- *Half* and *twice* are what half and twice auto's Gaussians gave, interpolated in the same way.

PSNR scatters between runs that differ in the number of Gaussians alone, and the plateau is the best of several such
runs: auto is held to a line that is a little too high."""
_RUN_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("seed", "seed", "d"),
    ("limit", "limit", ".0f"),
    ("gaussians", "Gaussians", "d"),
    ("psnr", "PSNR", ".2f"),
    ("ccpr", "CCPR", ".3f"),
    ("rwe", "RWE", ".3f"),
    ("geometry_seconds", "geometry, s", ".1f"),
    ("processor_seconds", "processor s", ".1f"),
    ("peak_memory_mb", "MB", ".0f"),
)
_VERDICT_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("plateau", "plateau, dB", ".2f"),
    ("knee", "knee", ".0f"),
    ("gaussians", "auto", ".0f"),
    ("times_knee", "auto / knee", ".2f"),
    ("psnr", "auto, dB", ".2f"),
    ("behind", "behind, dB", ".2f"),
    ("half", "half, dB", ".2f"),
    ("twice", "twice, dB", ".2f"),
)


@dataclass(frozen=True)
class Knee:
    """Where more Gaussians no longer pay.

    Attributes:
        plateau: best PSNR of all numbers of Gaussians, dB.
        gaussians: fewest that come within `TOLERANCE` of it, interpolated between runs in the logarithm of the number;
            an upper bound if even the fewest tried do.
    """

    plateau: float
    gaussians: float


def find_knee(runs: pd.DataFrame) -> Knee:
    """The knee of runs on one capture that differ only in their number of Gaussians.

    Args:
        runs: ``gaussians``, ``psnr`` and ``processor_seconds`` of each; at least one.
    """
    plateau = float(runs.psnr.max())
    return Knee(plateau, at_quality(runs, plateau - TOLERANCE).gaussians)


def quality_at(runs: pd.DataFrame, gaussians: float) -> float:
    """PSNR in dB at a number of Gaussians, interpolated as for the knee; beyond the runs, that of the nearest."""
    ordered = runs.sort_values("gaussians")
    return float(np.interp(np.log(gaussians), np.log(ordered.gaussians), ordered.psnr))


def measure_budgets(
    sources: Sequence[CaptureFolder],
    iterations: int,
    half_doublings: Sequence[int],
    folder: Path,
    reporter: Reporter,
    *,
    processes: int = 1,
    again: bool = False,
    seeds: int = 1,
) -> pd.DataFrame:
    """Train each capture automatically, and then with fixed numbers of Gaussians around that of the automatic run.

    Args:
        half_doublings: of the automatic run's number of Gaussians with the same seed.
        seeds: number of them.

    Returns:
        Columns of `Trial`, and ``limit``: most Gaussians that were asked for, 0 where they were decided automatically.
    """
    automatic = tuple(Recipe("auto", iterations=iterations, seed=seed) for seed in range(seeds))
    jobs = [Job(source, automatic) for source in sources]
    decided = run_jobs(jobs, folder, reporter, processes=processes, again=again)
    jobs = []
    for number, source in enumerate(sources):
        recipes: list[Recipe] = []
        for auto, trial in zip(automatic, decided[number * seeds :][:seeds], strict=True):
            limits = [round(trial.gaussians * 2.0 ** (halves / 2.0)) for halves in half_doublings if not trial.error]
            recipes += [replace(auto, label=f"{limit} Gaussians", gaussians=limit) for limit in limits]
        # Trainings have only the enhancer in common, so they may as well be spread over the processes.
        chunks = [tuple(recipes[start::processes]) for start in range(processes)]
        jobs += [Job(source, chunk) for chunk in chunks if chunk]
    trials = run_jobs(jobs, folder, reporter, processes=processes, again=again)
    limits = [0] * len(decided) + [recipe.gaussians or 0 for job in jobs for recipe in job.recipes]
    runs = frame_of(Trial, [*decided, *trials]).assign(limit=limits)
    order = {source.name: number for number, source in enumerate(sources)}
    by = ["capture", "seed", "limit"]
    return runs.sort_values(by, key=lambda key: key.map(order) if key.name == "capture" else key)


def judge(runs: pd.DataFrame) -> pd.DataFrame:
    """A verdict for each capture and seed that was trained automatically and with fixed numbers of Gaussians.

    Returns:
        ``capture``, ``seed``; ``plateau`` and ``knee`` of the fixed runs, see `Knee`; ``gaussians``, ``psnr`` and
        ``decision`` of the automatic run; ``half`` and ``twice``, the PSNR at half and twice its Gaussians; ``behind``,
        its distance to the plateau in dB, and ``times_knee``, its Gaussians relative to the knee.
    """
    verdicts: list[dict[str, Any]] = []
    for (capture, seed), made in runs[runs.error == ""].groupby(["capture", "seed"], sort=False):
        fixed, automatic = made[made.limit > 0], made[made.limit == 0]
        if fixed.empty or automatic.empty:
            continue
        auto, knee = automatic.iloc[0], find_knee(fixed)
        behind, times_knee = knee.plateau - auto.psnr, auto.gaussians / knee.gaussians
        verdicts.append(
            {
                "capture": capture,
                "seed": seed,
                "plateau": knee.plateau,
                "knee": knee.gaussians,
                **auto[["gaussians", "psnr", "decision"]],
                "half": quality_at(fixed, auto.gaussians / 2.0),
                "twice": quality_at(fixed, auto.gaussians * 2.0),
                "behind": behind,
                "times_knee": times_knee,
            }
        )
    return pd.DataFrame(verdicts)


def write_budget(folder: Path, runs: pd.DataFrame, heading: Sequence[str]) -> str:
    """Write ``budget.csv``, ``budget.md`` and its chart; returns the text of the page.

    Args:
        runs: as `measure_budgets` returns them.
        heading: lines that say how the figures were made.
    """
    names, caveat = [name for name, _, _ in _RUN_COLUMNS], optimistic(runs)
    runs = runs[[*names, "decision", "error"]]
    write_csv(folder / f"{NAME}.csv", runs)
    verdicts = judge(runs)
    definitions = _DEFINITIONS.format(range=_range(runs))
    lines = ["# How many Gaussians a scene needs", "", *heading, "", definitions, "", *caveat]
    if not verdicts.empty:
        figures = _VERDICT_COLUMNS[1:]
        means, deviations = means_and_deviations(verdicts, ["capture"], figures)
        size = (_PANEL_WIDTH * len(means), _HEIGHT)
        write_charts(folder, NAME, size, partial(_draw, runs=runs, verdicts=means))
        alternative = "PSNR, RWE and CCPR over the number of Gaussians; the tables below have the same figures"
        table = tables_of_means(means, deviations, _VERDICT_COLUMNS[:1], figures)
        said = verdicts.groupby("capture", sort=False).decision.first()
        lines += [picture(NAME, alternative), "", *table, "", *_in_words(means.assign(decision=said.to_numpy())), ""]
    shown = runs.assign(
        capture=runs.capture + runs.error.map(lambda error: f": {error}" if error else ""),
        limit=runs.limit.map(lambda limit: str(limit) if limit else "auto"),
        peak_memory_mb=runs.peak_memory_mb.where(runs.peak_memory_mb > 0),
    )
    lines += ["## All runs", "", *markdown_table(shown, _RUN_COLUMNS)]
    return write_text(folder / f"{NAME}.md", lines)


def _range(runs: pd.DataFrame) -> str:
    """From the least to the most times of the automatic number that were tried, in words; "" without any."""
    automatic = runs[(runs.limit == 0) & (runs.gaussians > 0)].set_index(["capture", "seed"]).gaussians
    fixed = runs[runs.limit > 0].set_index(["capture", "seed"]).limit
    times = (fixed / automatic.reindex(fixed.index)).dropna()
    return "" if times.empty else f" from {times.min():.2g} to {times.max():.2g} times what that took"


def _draw(figure: Figure, theme: Theme, runs: pd.DataFrame, verdicts: pd.DataFrame) -> None:
    """A column for each capture, a row for each figure, one legend below."""
    axes = figure.subplots(len(_FIGURES), len(verdicts), sharex="col", squeeze=False)
    for column, verdict in enumerate(verdicts.itertuples()):
        mine = runs[(runs.capture == verdict.capture) & (runs.error == "")]
        fixed, auto = mine[mine.limit > 0], mine[mine.limit == 0]
        for row, (name, title) in enumerate(_FIGURES):
            panel = axes[row, column]
            panel.set_title(title if row else f"{verdict.capture}: {title}")
            logarithmic(panel)
            for seed, some in fixed.groupby("seed"):
                plot_series(panel, some.gaussians, some[name], theme.series[row], "" if seed else "fixed limits")
            plot_stars(panel, auto.gaussians, auto[name], theme, "auto")
            panel.axvline(verdict.knee, color=theme.muted, linewidth=0.9, linestyle="dotted", label="knee")
            if name == "psnr":
                level = verdict.plateau - TOLERANCE
                words = f"{TOLERANCE:g} dB below the plateau"
                panel.axhline(level, color=theme.muted, linewidth=0.9, linestyle="dashed", label=words)
        axes[-1, column].set_xlabel("Gaussians")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 * min(len(verdicts), 2))


def _in_words(verdicts: pd.DataFrame) -> list[str]:
    """Whether each capture reaches the target, and the reason that the automatic decision gave."""
    lines = []
    for v in verdicts.itertuples():
        on_plateau, is_lean = v.behind <= TOLERANCE, v.times_knee <= ALLOWED
        quality = "on the plateau" if on_plateau else f"{v.behind:.2f} dB below the plateau"
        size = f"{v.times_knee:.2f} times the knee's Gaussians"
        reached = "reached" if on_plateau and is_lean else "missed"
        lines.append(f"- **{v.capture}**: target {reached}: auto is {quality} with {size}. It said: {v.decision}.")
    return lines


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, max_size=SIZE, iterations=ITERATIONS, seeds=SEEDS)


def _measure(options: argparse.Namespace) -> str:
    """Train captures with automatic and fixed numbers of Gaussians; writes budget.csv, budget.md and a chart."""
    options = with_quick_defaults(options)
    runs = measure_budgets(
        chosen_sources(options),
        options.iterations,
        FEW_HALF_DOUBLINGS if options.quick else HALF_DOUBLINGS,
        work_folder(options),
        ConsoleReporter(sys.stderr),
        processes=options.processes,
        again=options.again,
        seeds=options.seeds,
    )
    return write_budget(options.out, runs, made_by(options, runs))


PART = Part(
    NAME,
    "PSNR, consistency and contrast over the number of Gaussians, and where auto stops",
    _add_arguments,
    _measure,
    pages=(f"{NAME}.md",),
    shaped_by=lambda: (*trained_product(), Recipe("any"), HALF_DOUBLINGS, TOLERANCE, ALLOWED),
)
