"""Fits Gaussians to photographs with known cameras: the optimisation loop, its schedule and its curve."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from ..events import Reporter
from .gaussians import Gaussians
from .initialise import InitialGaussians
from .raster import Adam, LearningRates, ParameterSet, Rasterizer
from .scene_frame import SceneFrame
from .evidence import gather_view_evidence
from .strategy import CloneSplitPrune, Evidence, Strategy
from .targets import Background, TrainingView, prepare_targets

STAGE = "geometry"


@dataclass(frozen=True)
class TrainingPlan:
    """Everything that shapes a training run; the same for every scene.

    Attributes:
        steps: optimisation steps, one view each.
        limit: most Gaussians.
        sh_degree: of the colours; terms above 0 start at zero.
        ssim_weight: λ of (1 - λ) L1 + λ (1 - SSIM).
        rates: step sizes at the start, in frame units where they are lengths; about four times those of 3DGS,
            whose runs are six times as long.
        means_decay, rates_decay: what is left of the step sizes at the end, reached exponentially.
        coarse: (fraction of the run, factor) pairs: until then the photographs are reduced by the factor.
        initial: how the first Gaussians are made.
        strategy: how their set changes.
        curve_points: how often held-out views are measured.
        curve_views: at most so many of them each time.
    """

    steps: int = 5000
    limit: int = 40_000
    sh_degree: int = 0
    ssim_weight: float = 0.2
    rates: LearningRates = field(
        default_factory=lambda: LearningRates(
            means=6.4e-4, log_scales=2e-2, quaternions=4e-3, opacity_logits=1e-1, sh0=1e-2, sh_rest=5e-4
        )
    )
    means_decay: float = 0.02
    rates_decay: float = 0.2
    coarse: tuple[tuple[float, int], ...] = ((0.2, 2),)
    initial: InitialGaussians = field(default_factory=InitialGaussians)
    strategy: Strategy = field(default_factory=CloneSplitPrune)
    curve_points: int = 10
    curve_views: int = 6


@dataclass(frozen=True)
class TrainingResult:
    """What training gave.

    Attributes:
        gaussians: in world units.
        curve: one entry a measurement: step, seconds, psnr (held-out, dB; None without such views), gaussians.
        seconds: of the loop and its preparation, without the measurements.
        initial: Gaussians at the start.
    """

    gaussians: Gaussians
    curve: list[dict[str, float | None]]
    seconds: float
    initial: int


class Trainer:
    """One training run over `views`; `train` does it.

    Args:
        rasterizer: does the arithmetic.
        views: to fit.
        held_out: to measure on, never to fit; may be empty.
        points, colors: (P, 3) sparse points in world units and their (P, 3) uint8 sRGB colours; P may be 0.
        plan: the settings.
        background: what is behind the Gaussians.
        seed: of the initialisation, the order of the views and the splits.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        views: Sequence[View],
        held_out: Sequence[View],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
        plan: TrainingPlan,
        background: Background,
        seed: int,
    ) -> None:
        self._started = time.perf_counter()
        self._measuring = 0.0
        self._rasterizer = rasterizer
        self._plan = plan
        self._background = background
        self._rng = np.random.default_rng(seed)
        self._frame = SceneFrame.around(views, points)
        self._targets = prepare_targets(
            rasterizer, views, self._frame, background, {factor for _, factor in plan.coarse}
        )
        self._held_out = prepare_targets(
            rasterizer, held_out[:: max(len(held_out) // plan.curve_views, 1)], self._frame, background, set()
        )
        initial = plan.initial.make(views, points, colors, self._frame, self._rng, plan.limit)
        self._initial = len(initial)
        self._parameters = ParameterSet.from_gaussians(_with_sh_degree(initial, plan.sh_degree), rasterizer.device)
        self._adam = Adam(self._parameters)
        self._gradient = np.zeros(len(initial), np.float64)
        self._observed = np.zeros(len(initial), np.int64)
        self._order: list[int] = []
        self._curve: list[dict[str, float | None]] = []

    def train(self, reporter: Reporter) -> TrainingResult:
        """Run all steps."""
        plan = self._plan
        reporter.status(STAGE, f"fitting {self._initial:,} Gaussians to {len(self._targets)} views")
        measured = {round(plan.steps * (i + 1) / plan.curve_points) for i in range(plan.curve_points)}
        psnr = self._measure(0)
        for step in range(1, plan.steps + 1):
            self.step(step)
            if plan.strategy.schedule.due(step, plan.steps):
                self._refine(step)
            if step in measured:
                psnr = self._measure(step)
            if step % 10 == 0 or step == plan.steps:
                quality = f", {psnr:.1f} dB" if psnr is not None else ""
                reporter.progress(STAGE, step / plan.steps, f"{self._count:,} Gaussians{quality}")
        gaussians = self._frame.to_world(self._parameters.to_gaussians())
        return TrainingResult(gaussians, self._curve, self._seconds, self._initial)

    @property
    def _count(self) -> int:
        return len(self._parameters)

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._started - self._measuring

    def step(self, step: int) -> None:
        """One optimisation step: render a view, measure the loss, go backward, move the parameters."""
        target = self._next_target()
        image, camera = target.at(self._reduction(step))
        frame = self._rasterizer.render(self._parameters, camera, self._background.color)
        self._rasterizer.photometric_loss(frame, image, self._plan.ssim_weight)
        strategy = self._plan.strategy
        gathers = strategy.gradient_every > 0 and step % strategy.gradient_every == 0
        gathers = gathers and strategy.schedule.growing(step, self._plan.steps)
        gradients = self._rasterizer.backward(frame, absolute=gathers)
        self._adam.step(self._rasterizer, self._parameters, gradients, self._rates(step))
        if gathers:
            visible = frame.visible.numpy()
            self._gradient += np.where(visible, gradients.screen_abs.numpy(), 0.0)
            self._observed += visible != 0

    def _next_target(self) -> TrainingView:
        if not self._order:
            self._order = self._rng.permutation(len(self._targets)).tolist()
        return self._targets[self._order.pop()]

    def _reduction(self, step: int) -> int:
        return next((factor for until, factor in self._plan.coarse if step <= until * self._plan.steps), 1)

    def _rates(self, step: int) -> LearningRates:
        """The step sizes at `step`: exponential from the start's to the end's."""
        plan, progress = self._plan, step / self._plan.steps
        rest = plan.rates_decay**progress
        return LearningRates(
            means=plan.rates.means * plan.means_decay**progress,
            log_scales=plan.rates.log_scales * rest,
            quaternions=plan.rates.quaternions * rest,
            opacity_logits=plan.rates.opacity_logits * rest,
            sh0=plan.rates.sh0 * rest,
            sh_rest=plan.rates.sh_rest * rest,
        )

    def _refine(self, step: int) -> None:
        plan = self._plan
        mean_gradient = (self._gradient / np.maximum(self._observed, 1)).astype(np.float32)
        budget = plan.strategy.schedule.budget(step, plan.steps, self._initial, plan.limit)
        wanted = plan.strategy.views_wanted(step, plan.steps, len(self._targets))
        seen = None
        if wanted:
            chosen = np.sort(self._rng.choice(len(self._targets), wanted, replace=False))
            seen = gather_view_evidence(
                self._rasterizer,
                self._parameters,
                [self._targets[i] for i in chosen],
                self._background,
                self._reduction(step),
                wanted == len(self._targets),
            )
        evidence = Evidence(mean_gradient, seen)
        refined = plan.strategy.refine(self._parameters.to_gaussians(), evidence, budget, self._rng)
        self._parameters = ParameterSet.from_gaussians(refined.gaussians, self._rasterizer.device)
        self._adam.select(refined.source, refined.fresh)
        self._gradient = np.zeros(self._count, np.float64)
        self._observed = np.zeros(self._count, np.int64)

    def _measure(self, step: int) -> float | None:
        """Append to the curve; returns the held-out PSNR."""
        started = time.perf_counter()
        psnr = None
        if self._held_out:
            errors = [_psnr(self._rasterizer, self._parameters, view, self._background) for view in self._held_out]
            psnr = float(np.mean(errors))
        self._measuring += time.perf_counter() - started
        self._curve.append({"step": step, "seconds": round(self._seconds, 2), "psnr": psnr, "gaussians": self._count})
        return psnr


def _psnr(rasterizer: Rasterizer, parameters: ParameterSet, view: TrainingView, background: Background) -> float:
    image, camera = view.at(1)
    color = np.clip(rasterizer.render(parameters, camera, background.color).color.numpy(), 0.0, 1.0)
    error = (color - image.numpy().astype(np.float32) / 255.0) ** 2
    return float(-10.0 * np.log10(max(error.mean(), 1e-12)))


def _with_sh_degree(gaussians: Gaussians, degree: int) -> Gaussians:
    """The same colours with room for the terms up to `degree`."""
    sh = np.zeros((len(gaussians), (degree + 1) ** 2, 3), np.float32)
    sh[:, : gaussians.sh.shape[1]] = gaussians.sh
    return Gaussians(gaussians.means, gaussians.log_scales, gaussians.quaternions, gaussians.opacity_logits, sh)
