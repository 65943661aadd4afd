"""One training of a capture and what it cost: what the comparisons of trainings are made of."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...capture import Capture
from ...events import Reporter
from ...splats.plan import TrainingPlan
from ...splats.raster import Rasterizer
from ...splats.targets import Background
from ...splats.trainer import Trainer
from ..evaluation import Split


@dataclass(frozen=True)
class TrainedRun:
    """What one training gave and cost.

    Attributes:
        capture, label: what was trained, and how, in words.
        seed: of everything random.
        steps: that were planned.
        gaussians, sh_degree: of the result.
        psnr: of the held-out views, dB.
        seconds, processor_seconds: wall time without measuring, and processor time of all threads, which a neighbour on
            a shared machine disturbs less.
        decision: what was said of the number of Gaussians.
        curve: (seconds, PSNR) in the course of it.
    """

    capture: str
    label: str
    seed: int
    steps: int
    gaussians: int
    sh_degree: int
    psnr: float
    seconds: float
    processor_seconds: float
    decision: str
    curve: tuple[tuple[float, float], ...]

    def seconds_to(self, psnr: float) -> float:
        """When the held-out PSNR was first measured to be at least `psnr`; NaN where it never was."""
        return first_reaching(self.curve, psnr)


def train_once(
    capture: Capture, label: str, plan: TrainingPlan, *, seed: int = 0, threads: int | None = None
) -> TrainedRun:
    """Train on all views but every eighth, and measure on these.

    Raises:
        ValueError: too few views to hold one out.
    """
    views = capture.views
    split = Split.every(len(views))
    if len(split.train) < 2:
        raise ValueError(f"{len(views)} views are too few to hold some out")
    started = time.process_time()
    trainer = Trainer(
        Rasterizer("cpu", threads),
        [views[i] for i in split.train],
        [views[i] for i in split.test],
        capture.points,
        capture.point_colors,
        plan,
        Background.of(views),
        seed,
    )
    result = trainer.train(Reporter())
    curve = tuple((float(entry["seconds"] or 0.0), float(entry["psnr"] or 0.0)) for entry in result.curve)
    return TrainedRun(
        capture=capture.source.name,
        label=label,
        seed=seed,
        steps=plan.steps,
        gaussians=len(result.gaussians),
        sh_degree=result.gaussians.sh_degree,
        psnr=curve[-1][1],
        seconds=result.seconds,
        processor_seconds=time.process_time() - started,
        decision=str(result.decision["gaussians"]),
        curve=curve,
    )


def first_reaching(curve: Sequence[tuple[float, float]], psnr: float) -> float:
    """The first time of a (seconds, PSNR) curve at which `psnr` is reached; NaN where it never is."""
    return next((seconds for seconds, value in curve if value >= psnr), math.nan)


@dataclass(frozen=True)
class AtQuality:
    """What a quality costs, read off several runs of different sizes; NaN where they do not reach it.

    Attributes:
        gaussians: how many.
        processor_seconds: of the training.
    """

    gaussians: float
    processor_seconds: float


class Sized(Protocol):
    """What any kind of run says of its size, its quality and its cost; see `TrainedRun`."""

    @property
    def gaussians(self) -> int: ...

    @property
    def psnr(self) -> float: ...

    @property
    def processor_seconds(self) -> float: ...


def at_quality(runs: Sequence[Sized], psnr: float) -> AtQuality:
    """Interpolates between runs: PSNR is nearly linear in the logarithm of the number of Gaussians.

    The smallest run that reaches `psnr` and the largest that does not count; where all reach it, the smallest does,
    which is then an upper bound.
    """
    ordered = sorted(runs, key=lambda run: run.gaussians)
    above = next((i for i, run in enumerate(ordered) if run.psnr >= psnr), None)
    if above is None:
        return AtQuality(math.nan, math.nan)
    upper = ordered[above]
    if above == 0:
        return AtQuality(float(upper.gaussians), upper.processor_seconds)
    lower = ordered[above - 1]
    share = (psnr - lower.psnr) / (upper.psnr - lower.psnr)
    logarithms = np.log([lower.gaussians, upper.gaussians])
    gaussians = float(np.exp(logarithms[0] + share * (logarithms[1] - logarithms[0])))
    seconds = lower.processor_seconds + share * (upper.processor_seconds - lower.processor_seconds)
    return AtQuality(gaussians, seconds)
