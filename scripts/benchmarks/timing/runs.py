"""One training of a capture with its quality and cost, and the cost of a quality among several."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ....core.capture.model import Capture
from ....core.errors import InputError
from ....core.evaluate.evaluation import Split
from ....core.runtime.protocol import Reporter
from ....core.splats.gaussians import Gaussians
from ....core.splats.raster import Rasterizer
from ....core.splats.renderer import SceneRenderer
from ....core.splats.targets import Background
from ....core.splats.training.plan import TrainingPlan
from ....core.splats.training.trainer import Trainer


@dataclass(frozen=True)
class TrainedRun:
    """The result and cost of one training.

    Attributes:
        capture, label: what was trained, and how.
        seed: of everything random.
        steps: planned steps.
        gaussians, sh_degree: of the result.
        psnr: of the held-out views, dB.
        seconds, processor_seconds: wall time, and processor time of all threads, which depends less on the load of a
            shared machine; both without measuring, which is taken to use as many threads as training.
        decision: the reason for the number of Gaussians.
        curve: (seconds, PSNR) during training.
        decided_on_held_out: as of `TrainingResult`.
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
    decided_on_held_out: bool = False

    def seconds_to(self, psnr: float) -> float:
        """The first time at which a held-out PSNR of at least `psnr` was measured; NaN if it never was."""
        return next((seconds for seconds, value in self.curve if value >= psnr), math.nan)

    @property
    def busy(self) -> float:
        """Processor seconds in a second of training."""
        return self.processor_seconds / self.seconds


def train_once(
    capture: Capture,
    label: str,
    plan: TrainingPlan,
    *,
    seed: int = 0,
    threads: int | None = None,
    device: str = "cpu",
) -> TrainedRun:
    """Train on all views except every eighth, and measure on those.

    Raises:
        InputError: too few views to hold one out.
    """
    views = capture.views
    split = Split.every(len(views))
    if len(split.train) < 2:
        what = f"{len(views)} views are too few to hold some out"
        raise InputError(what, where=capture.source, remedy="give a capture of more views")
    started, processor = time.perf_counter(), time.process_time()
    trainer = Trainer(
        Rasterizer(device, threads),
        [views[i] for i in split.train],
        [views[i] for i in split.test],
        capture.points,
        capture.point_colors,
        plan,
        Background.of(views),
        seed,
    )
    result = trainer.train(Reporter())
    busy = (time.process_time() - processor) / (time.perf_counter() - started)
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
        processor_seconds=busy * result.seconds,
        decision=str(result.decision["gaussians"]),
        curve=curve,
        decided_on_held_out=result.decided_on_held_out,
    )


def held_out_psnr(drawn: SceneRenderer, gaussians: Gaussians, test: Sequence[int]) -> float:
    """Mean PSNR in dB of the `test` views, of Gaussians that another program may have made."""
    return float(np.mean([drawn.fidelity(i, drawn.color(gaussians, i))["psnr"] for i in test]))


@dataclass(frozen=True)
class AtQuality:
    """The cost of a quality, interpolated between runs of different sizes; NaN if they do not reach it.

    Attributes:
        gaussians: their number.
        processor_seconds: of the training.
    """

    gaussians: float
    processor_seconds: float


def at_quality(runs: pd.DataFrame, psnr: float) -> AtQuality:
    """Interpolate between runs: PSNR is nearly linear in the logarithm of the number of Gaussians.

    Between the smallest run that reaches `psnr` and the largest below it; if all reach it, the smallest is an upper
    bound.

    Args:
        runs: ``gaussians``, ``psnr`` and ``processor_seconds`` of each.
    """
    ordered = runs.sort_values("gaussians").reset_index()
    reaching = ordered[ordered.psnr >= psnr]
    if reaching.empty:
        return AtQuality(math.nan, math.nan)
    upper = reaching.iloc[0]
    if reaching.index[0] == 0:
        return AtQuality(float(upper.gaussians), float(upper.processor_seconds))
    lower = ordered.iloc[reaching.index[0] - 1]
    share = (psnr - lower.psnr) / (upper.psnr - lower.psnr)
    logarithms = np.log([lower.gaussians, upper.gaussians])
    gaussians = float(np.exp(logarithms[0] + share * (logarithms[1] - logarithms[0])))
    seconds = lower.processor_seconds + share * (upper.processor_seconds - lower.processor_seconds)
    return AtQuality(gaussians, float(seconds))
