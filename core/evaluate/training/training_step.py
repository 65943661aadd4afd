"""Times the trainer's own step on a capture, without densification: what a benchmark compares between programs."""

from __future__ import annotations

import statistics
import time

from ...capture import Capture
from ...splats.raster import Rasterizer
from ...splats.strategy import CloneSplitPrune, Schedule
from ...splats.targets import Background
from ...splats.trainer import Trainer, TrainingPlan
from ..evaluation import Split

_NEVER = CloneSplitPrune(schedule=Schedule(start=2.0, stop=3.0, rounds=1))  # beyond the end of the run


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
    return 1000.0 * statistics.median(seconds[-100:])
