"""Times the trainer's step on a capture, without densification, alone and beside a busy process.

Command: ``benchmark.py step``.
"""

from __future__ import annotations

import argparse
import contextlib
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ....core.capture.model import Capture
from ....core.capture.reader import read_capture
from ....core.demo import SHOWROOM
from ....core.evaluate.evaluation import Split
from ....core.runtime.cli import ConsoleReporter
from ....core.runtime.protocol import Reporter
from ....core.splats.raster import Rasterizer
from ....core.splats.raster.benchmark import StepTimes, benchmark_camera, benchmark_step, random_gaussians
from ....core.splats.strategy import Schedule
from ....core.splats.targets import Background
from ....core.splats.training.plan import TrainingPlan
from ....core.splats.training.trainer import Trainer
from ..options import Part, positive
from ..strategies import CloneSplitPrune
from ..tables import write_csv, write_text

STEPS = 300
SIZE = 480  # pixels of the longer side
STAGE = "steps"
_COUNTED = 100  # last steps of a round, over which the median is taken
_RANDOM_GAUSSIANS = 10_000
_NEVER = CloneSplitPrune(schedule=Schedule(start=2.0, stop=3.0, rounds=1))  # beyond the end of the run


@dataclass(frozen=True)
class StepFigures:
    """Times of training steps.

    Attributes:
        rounds: milliseconds of a step in each round.
        steps: of each round.
        beside_ms: milliseconds of a step beside a process that keeps one core busy.
        stages: times of the stages of a step on random Gaussians.
    """

    rounds: list[float]
    steps: int
    beside_ms: float
    stages: StepTimes


def measure_steps(
    capture: Capture, rounds: int, threads: int, reporter: Reporter | None = None, *, steps: int = STEPS
) -> StepFigures:
    """Time the step on a capture in several rounds, once more beside a busy process, and stage by stage."""
    reporter = reporter or Reporter()
    found = []
    for number in range(1, rounds + 1):
        found.append(training_step_milliseconds(capture, steps, threads))
        reporter.progress(STAGE, number / rounds, f"{found[-1]:.2f} ms")
    with _busy_neighbour():
        beside = training_step_milliseconds(capture, steps, threads)
    camera = capture.views[0].camera
    scene = random_gaussians(_RANDOM_GAUSSIANS, camera.width, camera.height)
    stages = benchmark_step(
        scene, benchmark_camera(camera.width, camera.height), capture.views[0].image, threads=threads
    )
    return StepFigures(found, steps, beside, stages)


def training_step_milliseconds(capture: Capture, steps: int, threads: int) -> float:
    """Median wall time of a whole step (render, loss, backward, Adam) over the last hundred of `steps`.

    One Gaussian per point, full resolution from the first step on.
    """
    limit = max(len(capture.points), 1)
    plan = TrainingPlan(steps=steps, limit=limit, coarse=(), poses=None, strategy=_NEVER, curve_points=1)
    trainer = Trainer(
        Rasterizer("cpu", threads),
        [capture.views[i] for i in Split.every(len(capture.views)).train],
        [],
        capture.points,
        capture.point_colors,
        plan,
        Background.of(capture.views),
        seed=0,
    )
    seconds = []
    for step in range(1, steps + 1):
        started = time.perf_counter()
        trainer.step(step)
        seconds.append(time.perf_counter() - started)
    return 1000.0 * statistics.median(seconds[-_COUNTED:])


def write_steps(folder: Path, capture: Capture, figures: StepFigures) -> str:
    """Write ``step.csv`` and ``step.md``; returns the text of the latter."""
    camera, rounds, stages = capture.views[0].camera, figures.rounds, figures.stages
    write_csv(folder / "step.csv", pd.DataFrame({"round": range(1, len(rounds) + 1), "step_ms": rounds}))
    lines = [
        f"Whole training step, {capture.source.name} at {camera.width}x{camera.height}, {len(capture.points)} "
        f"Gaussians; medians of {len(rounds)} runs of {figures.steps} steps:",
        "",
        f"- {statistics.median(rounds):.1f} ms",
        f"- beside one busy process {figures.beside_ms:.1f} ms",
        "",
        f"Stages, {stages.gaussians} random Gaussians, medians in ms: "
        + ", ".join(f"{name} {times.wall:.1f}" for name, times in stages.stages.items()),
    ]
    return write_text(folder / "step.md", lines)


@contextlib.contextmanager
def _busy_neighbour() -> Iterator[None]:
    """Another process that keeps one core busy."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--capture", type=Path, default=SHOWROOM, help="capture to train on (the demo)")
    parser.add_argument("--rounds", type=positive, default=5, metavar="N", help="repetitions; their median counts (5)")
    parser.add_argument("--threads", type=positive, default=2, metavar="N", help="threads of the rasteriser (2)")


def _measure(options: argparse.Namespace) -> str:
    """Time the step; writes step.csv and step.md."""
    capture = read_capture(options.capture, max_size=SIZE)
    found = measure_steps(capture, options.rounds, options.threads, ConsoleReporter(sys.stderr))
    return write_steps(options.out, capture, found)


PART = Part("step", "how long a whole training step takes, alone and beside other work", _add_arguments, _measure)
