"""Times a whole training step against the prototype's loop, in one run and by turns, and writes what came out."""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ...capture import Capture
from ...events import Reporter
from ..tables import write_csv
from .prototype_loop import PrototypeLoop
from .step_benchmark import StepTimes, benchmark_camera, benchmark_step, random_gaussians
from .training_step import training_step_milliseconds

STEPS = 300
STAGE = "steps"
_COMPILING_STEPS = 120  # of the prototype's first call, which compiles and does not count
_RANDOM_GAUSSIANS = 10_000


@dataclass(frozen=True)
class Round:
    """One turn of both programs, in milliseconds a step; None where there is no prototype."""

    round: int
    ours_ms: float
    prototype_ms: float | None


@dataclass(frozen=True)
class StepComparison:
    """What was timed.

    Attributes:
        rounds: by turns.
        disturbed_ms: ours beside a process that keeps one processor busy.
        stages: of our step on random Gaussians.
    """

    rounds: list[Round]
    disturbed_ms: float
    stages: StepTimes


def compare_steps(
    capture: Capture, prototype_folder: Path, rounds: int, threads: int, reporter: Reporter | None = None
) -> StepComparison:
    """Time both programs by turns on the capture; ours alone where the prototype is missing."""
    reporter = reporter or Reporter()
    with tempfile.TemporaryDirectory() as scratch:
        prototype = None
        if PrototypeLoop.is_there(prototype_folder):
            prototype = PrototypeLoop(prototype_folder, capture, Path(scratch))
            prototype.step_milliseconds(_COMPILING_STEPS, threads)
        else:
            reporter.warning("no-prototype", f"no prototype at {prototype_folder}: ours alone")
        found = []
        for number in range(1, rounds + 1):
            ours = training_step_milliseconds(capture, STEPS, threads)
            theirs = prototype.step_milliseconds(STEPS, threads) if prototype else None
            found.append(Round(number, ours, theirs))
            message = f"ours {ours:.2f} ms" + (f", prototype {theirs:.2f} ms" if theirs is not None else "")
            reporter.progress(STAGE, number / rounds, message)
    with _busy_neighbour():
        disturbed = training_step_milliseconds(capture, STEPS, threads)
    camera = capture.views[0].camera
    scene = random_gaussians(_RANDOM_GAUSSIANS, camera.width, camera.height)
    stages = benchmark_step(
        scene, benchmark_camera(camera.width, camera.height), capture.views[0].image, threads=threads
    )
    return StepComparison(found, disturbed, stages)


def write_steps(folder: Path, capture: Capture, comparison: StepComparison) -> str:
    """Write ``step.csv`` and ``step.md``; returns the text of the latter."""
    write_csv(folder / "step.csv", Round, comparison.rounds)
    camera, rounds = capture.views[0].camera, comparison.rounds
    lines = [
        f"Whole training step, {capture.source.name} at {camera.width}x{camera.height}, {len(capture.points)} "
        f"Gaussians; medians of {len(rounds)} runs of {STEPS} steps:",
        "",
        f"- ours {statistics.median(turn.ours_ms for turn in rounds):.1f} ms",
    ]
    pairs = [(turn.ours_ms, turn.prototype_ms) for turn in rounds if turn.prototype_ms is not None]
    if pairs:
        lines += [
            f"- prototype {statistics.median(theirs for _, theirs in pairs):.1f} ms",
            f"- ratio {statistics.median(ours / theirs for ours, theirs in pairs):.2f}",
        ]
    stages = comparison.stages
    lines += [
        f"- ours beside one busy process {comparison.disturbed_ms:.1f} ms",
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
