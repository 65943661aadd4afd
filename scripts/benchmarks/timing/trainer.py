"""The trainer's figures: time to a quality, automatic runs, strategies at equal PSNR, seeds.

Command: ``benchmark.py trainer``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from ....core.capture.model import Capture
from ....core.capture.reader import read_capture
from ....core.demo import SHOWROOM
from ....core.errors import InputError
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.splats import raster
from ....core.splats.strategy import MultiViewConsistent, Strategy
from ....core.splats.training.plan import TrainingPlan
from ..options import Part, names, positive
from ..strategies import CloneSplitPrune
from ..studies.recipe import optimistic
from ..tables import Column, frame_of, markdown_table, number, write_csv, write_text
from .runs import TrainedRun, at_quality, train_once

STAGE = "trainings"
TABLES = ("time", "auto", "strategies", "seeds")
SIZE = 480  # pixels of the longer side
QUALITY = 26.06
"""dB on fox at 270x480: where OpenSplat's CPU build ends after 2,000 steps (docs/trainer/README.md)."""
QUICK_PLAN = TrainingPlan(steps=1000, limit=20_000, sh_degree=0, stopping=None, poses=None, curve_points=40)
"""The plan of `--iterations 1000 --gaussians 20000 --sh-degree 0 --no-refine-poses`, measured more often."""
REFERENCE, OURS = "clone-split", "multi-view"
STRATEGIES: dict[str, Strategy] = {REFERENCE: CloneSplitPrune(), OURS: MultiViewConsistent()}
LIMITS = (10_000, 20_000, 40_000)
"""Of our strategy's runs; the reference's run has the largest."""

_COLUMNS: tuple[Column, ...] = (
    ("capture", "capture", ""),
    ("label", "run", ""),
    ("seed", "seed", "d"),
    ("psnr", "PSNR", ".2f"),
    ("gaussians", "Gaussians", "d"),
    ("sh_degree", "SH degree", "d"),
    ("seconds", "seconds", ".1f"),
    ("processor_seconds", "processor seconds", ".1f"),
)


def time_to_quality(capture: Capture, rounds: int, threads: int, reporter: Reporter) -> pd.DataFrame:
    """Train several times.

    Returns:
        ``round`` and ``seconds`` of training until `QUALITY` was first measured, NaN if it never was.
    """
    seconds = []
    for turn in range(1, rounds + 1):
        seconds.append(train_once(capture, "quick", QUICK_PLAN, threads=threads).seconds_to(QUALITY))
        reporter.progress(STAGE, turn / rounds, f"{seconds[-1]:.1f} s")
    return pd.DataFrame({"round": range(1, rounds + 1), "seconds": seconds})


def automatic_runs(capture: Capture, iterations: Sequence[int], reporter: Reporter) -> list[TrainedRun]:
    """Trainings of these lengths with everything decided automatically, as by run.py's defaults."""
    plans = [(f"auto, {n:,} steps", TrainingPlan(steps=n, limit=None, sh_degree=None), 0) for n in iterations]
    return _train_all(capture, plans, reporter)


def compare_strategies(
    capture: Capture, iterations: int, reporter: Reporter, limits: Sequence[int] = LIMITS
) -> list[TrainedRun]:
    """The reference with the largest limit, and ours with all limits.

    All training views are fitted and all steps done, so that only the strategy differs.
    """
    pairs = [(REFERENCE, max(limits)), *((OURS, limit) for limit in limits)]
    plan = replace(QUICK_PLAN, steps=iterations)
    plans = [(name, replace(plan, limit=limit, strategy=STRATEGIES[name]), 0) for name, limit in pairs]
    return _train_all(capture, plans, reporter)


def compare_seeds(capture: Capture, iterations: int, seeds: int, reporter: Reporter) -> list[TrainedRun]:
    """The automatic run with seeds from 0 on."""
    plan = TrainingPlan(steps=iterations, limit=None, sh_degree=0)
    return _train_all(capture, [(f"auto, {iterations:,} steps", plan, seed) for seed in range(seeds)], reporter)


def _train_all(
    capture: Capture, plans: Sequence[tuple[str, TrainingPlan, int]], reporter: Reporter
) -> list[TrainedRun]:
    """One training for each label, plan and seed."""
    runs: list[TrainedRun] = []
    for done, (label, plan, seed) in enumerate(plans, start=1):
        runs.append(run := train_once(capture, label, plan, seed=seed))
        result = f"{run.psnr:.2f} dB, {run.gaussians:,} Gaussians, {run.seconds:.0f} s"
        reporter.progress(STAGE, done / len(plans), f"{run.capture}, {run.label}: {result}")
    return runs


def write_time_to_quality(folder: Path, capture: Capture, found: pd.DataFrame) -> str:
    """Write ``time_to_quality.csv`` and ``.md``; returns the text of the latter."""
    write_csv(folder / "time_to_quality.csv", found)
    camera = capture.views[0].camera
    lines = [
        f"# Seconds of training to {QUALITY} dB, {capture.source.name} at {camera.width}x{camera.height}",
        "",
        *markdown_table(found, [("round", "round", "d"), ("seconds", "seconds", ".1f")]),
        "",
        f"Median {number(found.seconds.median(skipna=False), '.1f')} s.",
    ]
    return write_text(folder / "time_to_quality.md", lines)


def write_runs(folder: Path, name: str, heading: str, runs: Sequence[TrainedRun]) -> str:
    """Write ``<name>.csv``, ``<name>_curves.csv`` and ``<name>.md``; returns the text of the last.

    Strategies are also compared at equal PSNR, and seeds by the spread of their PSNR.
    """
    found = frame_of(TrainedRun, [replace(run, curve=()) for run in runs])
    write_csv(folder / f"{name}.csv", found)
    curves = [(run.capture, run.label, run.gaussians, *point) for run in runs for point in run.curve]
    columns = ["capture", "label", "gaussians", "seconds", "psnr"]
    write_csv(folder / f"{name}_curves.csv", pd.DataFrame(curves, columns=columns))
    lines = [f"# {heading}", "", *markdown_table(found, _COLUMNS), "", *optimistic(found)]
    if name == "strategies":
        lines += _at_equal_quality(found)
    else:
        lines += ["The decisions on the number of Gaussians:", ""]
        lines += [f"- {run.capture}, {run.label}, seed {run.seed}: {run.decision}" for run in runs]
    if name == "seeds":
        lines += ["", f"Largest minus smallest PSNR: {found.psnr.max() - found.psnr.min():.2f} dB."]
    return write_text(folder / f"{name}.md", lines)


def _at_equal_quality(runs: pd.DataFrame) -> list[str]:
    """For each capture, the cost of the reference's PSNR with our strategy, relative to the reference's largest run."""
    lines, ratios = [], []
    for capture, mine in runs.groupby("capture", sort=False):
        references = mine[mine.label == REFERENCE]
        reference = references.loc[references.gaussians.idxmax()]
        needed = at_quality(mine[mine.label == OURS], reference.psnr)
        ratio = (needed.gaussians / reference.gaussians, needed.processor_seconds / reference.processor_seconds)
        ratios.append(ratio)
        lines.append(
            f"- {capture}: {reference.psnr:.2f} dB takes {number(ratio[0], '.2f')} of the Gaussians and "
            f"{number(ratio[1], '.2f')} of the processor time of {REFERENCE}"
        )
    means = [number(mean, ".2f") for mean in pd.DataFrame(ratios).mean(skipna=False)]
    return ["At equal PSNR:", "", *lines, f"- mean: {means[0]} of the Gaussians, {means[1]} of the time"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--of", type=names, default=TABLES, metavar="A,B", help=f"tables ({','.join(TABLES)})")
    add("--capture", type=Path, action="append", help="capture to train; repeatable (the demo)")
    add("--max-size", type=positive, default=SIZE, metavar="PIXELS", help=f"longer side of the views ({SIZE})")
    add("--iterations", type=positive, default=5000, metavar="N", help="steps of automatic runs, and a third (5000)")
    add("--strategy-iterations", type=positive, default=2000, metavar="N", help="steps for strategies and seeds (2000)")
    add("--rounds", type=positive, default=3, metavar="N", help="repetitions of the time to a quality (3)")
    add("--seeds", type=positive, default=5, metavar="N", help="random seeds (5)")
    add("--threads", type=positive, default=2, metavar="N", help="threads for the time to a quality (2)")


def _measure(options: argparse.Namespace) -> str:
    """Train captures in several ways; writes a table for each question. Times and seeds are of the first capture."""
    if unknown := set(options.of) - set(TABLES):
        raise InputError(f"unknown table '{min(unknown)}'", where="--of", remedy=f"use {', '.join(TABLES)}")
    reporter, out = ConsoleReporter(sys.stderr), options.out
    folders = options.capture or [SHOWROOM]
    captures = [read_capture(folder, max_size=options.max_size, reporter=reporter) for folder in folders]
    raster.load("cpu")  # compiles the kernels, which is no part of a training
    steps, texts = options.strategy_iterations, []
    if "time" in options.of:
        found = time_to_quality(captures[0], options.rounds, options.threads, reporter)
        texts.append(write_time_to_quality(out, captures[0], found))
    if "auto" in options.of:
        lengths = (options.iterations, options.iterations // 3)
        runs = [run for capture in captures for run in automatic_runs(capture, lengths, reporter)]
        texts.append(write_runs(out, "auto", "Everything decided automatically", runs))
    if "strategies" in options.of:
        runs = [run for capture in captures for run in compare_strategies(capture, steps, reporter)]
        texts.append(write_runs(out, "strategies", "Strategies", runs))
    if "seeds" in options.of:
        runs = compare_seeds(captures[0], steps, options.seeds, reporter)
        texts.append(write_runs(out, "seeds", f"Seeds, {runs[0].capture}, {runs[0].label}", runs))
    return "\n".join(texts)


PART = Part("trainer", "time to a quality, automatic decisions, strategies, seeds", _add_arguments, _measure)
