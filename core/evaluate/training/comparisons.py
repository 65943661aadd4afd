"""The trainer's figures: time to a quality, automatic runs, strategies at equal PSNR, seeds."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...capture import Capture
from ...events import Reporter
from ...splats import raster
from ...splats.plan import TrainingPlan
from ...splats.strategy import CloneSplitPrune, MultiViewConsistent, Strategy
from ..tables import markdown_table, number, write_csv
from .runs import TrainedRun, at_quality, train_once

STAGE = "trainings"
QUALITY = 26.06
"""dB on fox at 270x480: where OpenSplat's CPU build ends after 2,000 steps (docs/trainer.md)."""
QUICK_PLAN = TrainingPlan(steps=1000, limit=20_000, sh_degree=0, stopping=None, poses=None, curve_points=40)
"""What `--iterations 1000 --gaussians 20000 --sh-degree 0 --no-refine-poses` trains, measured more often."""
REFERENCE, OURS = "clone-split", "multi-view"
STRATEGIES: dict[str, Strategy] = {REFERENCE: CloneSplitPrune(), OURS: MultiViewConsistent()}
LIMITS = (10_000, 20_000, 40_000)
"""Of our strategy's runs; the reference's run has the largest."""


@dataclass(frozen=True)
class Reached:
    """Seconds of training until `QUALITY` was first measured; NaN where it never was."""

    round: int
    seconds: float


def time_to_quality(capture: Capture, rounds: int, threads: int, reporter: Reporter) -> list[Reached]:
    """Train several times."""
    found = []
    for turn in range(1, rounds + 1):
        run = train_once(capture, "quick", QUICK_PLAN, threads=threads)
        found.append(Reached(turn, run.seconds_to(QUALITY)))
        reporter.progress(STAGE, turn / rounds, f"{found[-1].seconds:.1f} s")
    return found


def automatic_runs(capture: Capture, iterations: Sequence[int], reporter: Reporter) -> list[TrainedRun]:
    """Trainings of so many iterations in which everything is decided automatically, as run.py's defaults do."""
    runs = []
    for done, steps in enumerate(iterations, start=1):
        plan = TrainingPlan(steps=steps, limit=None, sh_degree=None)
        runs.append(train_once(capture, f"auto, {steps:,} steps", plan))
        reporter.progress(STAGE, done / len(iterations), _in_words(runs[-1]))
    return runs


def compare_strategies(
    capture: Capture, iterations: int, reporter: Reporter, limits: Sequence[int] = LIMITS
) -> list[TrainedRun]:
    """The reference with the largest limit, and ours with all of them.

    All views are fitted where they are given and all steps done, so that only the strategy differs.
    """
    plans = [
        (name, replace(QUICK_PLAN, steps=iterations, limit=limit, strategy=STRATEGIES[name]))
        for name, limit in [(REFERENCE, max(limits)), *((OURS, limit) for limit in limits)]
    ]
    runs = []
    for done, (name, plan) in enumerate(plans, start=1):
        runs.append(train_once(capture, name, plan))
        reporter.progress(STAGE, done / len(plans), _in_words(runs[-1]))
    return runs


def compare_seeds(capture: Capture, iterations: int, seeds: int, reporter: Reporter) -> list[TrainedRun]:
    """The automatic run with seeds from 0 on."""
    plan = TrainingPlan(steps=iterations, limit=None, sh_degree=0)
    runs = []
    for seed in range(seeds):
        runs.append(train_once(capture, f"auto, {iterations:,} steps", plan, seed=seed))
        reporter.progress(STAGE, (seed + 1) / seeds, _in_words(runs[-1]))
    return runs


def warm_up() -> None:
    """Compile or load the kernels, which is no part of a training."""
    raster.load("cpu")


def write_time_to_quality(folder: Path, capture: Capture, found: Sequence[Reached]) -> str:
    """Write ``time_to_quality.csv`` and ``.md``; returns the text of the latter."""
    write_csv(folder / "time_to_quality.csv", Reached, found)
    camera = capture.views[0].camera
    rows = [[str(turn.round), number(turn.seconds, 1)] for turn in found]
    lines = [
        f"# Seconds of training to {QUALITY} dB, {capture.source.name} at {camera.width}x{camera.height}",
        "",
        *markdown_table(["round", "seconds"], rows),
        "",
        f"Median {number(statistics.median(turn.seconds for turn in found), 1)} s.",
    ]
    return _write(folder / "time_to_quality.md", lines)


def write_automatic_runs(folder: Path, runs: Sequence[TrainedRun]) -> str:
    """Write ``auto.csv`` and ``auto.md``; returns the text of the latter."""
    _write_runs(folder / "auto.csv", runs)
    header = ["capture", "run", "PSNR", "Gaussians", "SH degree", "seconds", "decision"]
    body = [
        [
            run.capture,
            run.label,
            number(run.psnr, 2),
            str(run.gaussians),
            str(run.sh_degree),
            number(run.seconds, 1),
            run.decision,
        ]
        for run in runs
    ]
    return _write(folder / "auto.md", ["# Everything decided automatically", "", *markdown_table(header, body)])


def write_strategies(folder: Path, runs: Sequence[TrainedRun]) -> str:
    """Write ``strategies.csv`` and ``strategies.md``, with what equal PSNR costs; returns the text of the latter."""
    _write_runs(folder / "strategies.csv", runs)
    header = ["capture", "strategy", "Gaussians", "PSNR", "seconds", "processor seconds"]
    body = [
        [
            run.capture,
            run.label,
            str(run.gaussians),
            number(run.psnr, 2),
            number(run.seconds, 1),
            number(run.processor_seconds, 1),
        ]
        for run in runs
    ]
    lines = ["# Strategies", "", *markdown_table(header, body), "", *_at_equal_quality(runs)]
    return _write(folder / "strategies.md", lines)


def write_seeds(folder: Path, runs: Sequence[TrainedRun]) -> str:
    """Write ``seeds.csv`` and ``seeds.md``; returns the text of the latter."""
    _write_runs(folder / "seeds.csv", runs)
    header = ["seed", "PSNR", "Gaussians", "seconds", "decision"]
    body = [
        [str(run.seed), number(run.psnr, 2), str(run.gaussians), number(run.seconds, 1), run.decision] for run in runs
    ]
    spread = max(run.psnr for run in runs) - min(run.psnr for run in runs)
    lines = [f"# Seeds, {runs[0].capture}, {runs[0].label}", "", *markdown_table(header, body), ""]
    return _write(folder / "seeds.md", [*lines, f"Largest minus smallest PSNR: {spread:.2f} dB."])


def _at_equal_quality(runs: Sequence[TrainedRun]) -> list[str]:
    """For each capture, what our strategy needs for the PSNR of the reference's largest run, relative to that run."""
    lines, ratios = [], []
    for capture in dict.fromkeys(run.capture for run in runs):
        mine = [run for run in runs if run.capture == capture]
        reference = max((run for run in mine if run.label == REFERENCE), key=lambda run: run.gaussians)
        needed = at_quality([run for run in mine if run.label == OURS], reference.psnr)
        ratio = (needed.gaussians / reference.gaussians, needed.processor_seconds / reference.processor_seconds)
        ratios.append(ratio)
        lines.append(
            f"- {capture}: {reference.psnr:.2f} dB takes {number(ratio[0], 2)} of the Gaussians and "
            f"{number(ratio[1], 2)} of the processor time of {REFERENCE}"
        )
    means = [number(statistics.fmean(values), 2) for values in zip(*ratios, strict=True)]
    return ["At equal PSNR:", "", *lines, f"- mean: {means[0]} of the Gaussians, {means[1]} of the time"]


def _in_words(run: TrainedRun) -> str:
    return f"{run.capture}, {run.label}: {run.psnr:.2f} dB, {run.gaussians:,} Gaussians, {run.seconds:.0f} s"


@dataclass(frozen=True)
class _CurvePoint:
    capture: str
    label: str
    gaussians: int
    seconds: float
    psnr: float


def _write_runs(path: Path, runs: Sequence[TrainedRun]) -> None:
    """The runs, and beside them their curves."""
    write_csv(path, TrainedRun, [replace(run, curve=()) for run in runs])
    points = [_CurvePoint(run.capture, run.label, run.gaussians, *point) for run in runs for point in run.curve]
    write_csv(path.with_name(f"{path.stem}_curves.csv"), _CurvePoint, points)


def _write(path: Path, lines: Sequence[str]) -> str:
    text = "\n".join(lines) + "\n"
    path.write_text(text, encoding="utf-8")
    return text
