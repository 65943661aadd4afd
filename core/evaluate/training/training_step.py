"""Times the trainer's own step on a capture, without densification, alone and beside a busy process."""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ...capture import Capture
from ...events import Reporter
from ...splats.plan import TrainingPlan
from ...splats.raster import Rasterizer
from ...splats.strategy import CloneSplitPrune, Schedule
from ...splats.targets import Background
from ...splats.trainer import Trainer
from ..evaluation import Split
from ..tables import write_csv
from .step_benchmark import StepTimes, benchmark_camera, benchmark_step, random_gaussians

STEPS = 300
STAGE = "steps"
_COUNTED = 100  # the last steps of a round, whose median counts
_RANDOM_GAUSSIANS = 10_000
_NEVER = CloneSplitPrune(schedule=Schedule(start=2.0, stop=3.0, rounds=1))  # beyond the end of the run


@dataclass(frozen=True)
class Round:
    """Milliseconds of a step in one round."""

    round: int
    step_ms: float


@dataclass(frozen=True)
class StepFigures:
    """What was timed.

    Attributes:
        rounds: one after the other.
        steps: of each.
        disturbed_ms: a step beside a process that keeps one processor busy.
        stages: of a step on random Gaussians.
    """

    rounds: list[Round]
    steps: int
    disturbed_ms: float
    stages: StepTimes


def measure_steps(
    capture: Capture, rounds: int, threads: int, reporter: Reporter | None = None, *, steps: int = STEPS
) -> StepFigures:
    """Time the step on a capture in several rounds, once more beside a busy process, and stage by stage."""
    reporter = reporter or Reporter()
    found = []
    for number in range(1, rounds + 1):
        found.append(Round(number, training_step_milliseconds(capture, steps, threads)))
        reporter.progress(STAGE, number / rounds, f"{found[-1].step_ms:.2f} ms")
    with _busy_neighbour():
        disturbed = training_step_milliseconds(capture, steps, threads)
    camera = capture.views[0].camera
    scene = random_gaussians(_RANDOM_GAUSSIANS, camera.width, camera.height)
    stages = benchmark_step(
        scene, benchmark_camera(camera.width, camera.height), capture.views[0].image, threads=threads
    )
    return StepFigures(found, steps, disturbed, stages)


def training_step_milliseconds(capture: Capture, steps: int, threads: int) -> float:
    """Median wall time of a whole step (render, loss, backward, Adam) over the last hundred of `steps`.

    One Gaussian a point, full resolution from the first step on.
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
    write_csv(folder / "step.csv", Round, figures.rounds)
    camera, rounds, stages = capture.views[0].camera, figures.rounds, figures.stages
    lines = [
        f"Whole training step, {capture.source.name} at {camera.width}x{camera.height}, {len(capture.points)} "
        f"Gaussians; medians of {len(rounds)} runs of {figures.steps} steps:",
        "",
        f"- {statistics.median(turn.step_ms for turn in rounds):.1f} ms",
        f"- beside one busy process {figures.disturbed_ms:.1f} ms",
        "",
        f"Stages, {stages.gaussians} random Gaussians, medians in ms: "
        + ", ".join(f"{name} {times.wall:.1f}" for name, times in stages.stages.items()),
    ]
    text = "\n".join(lines) + "\n"
    (folder / "step.md").write_text(text, encoding="utf-8")
    return text


@contextlib.contextmanager
def _busy_neighbour() -> Iterator[None]:
    """Another process that keeps one processor busy."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()
