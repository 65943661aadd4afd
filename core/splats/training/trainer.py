"""Trains Gaussians on photographs with known cameras: the optimisation loop.

A run follows its `TrainingPlan`. Each step fits one view (`fitting.Fit`), at the resolution and learning rates of the
`TrainingSchedule`; every so often the `Strategy` densifies and prunes. Validation views, which are not fitted, decide
when growth and training end and which SH degree pays (`decisions`); near the end of the run they are fitted, too.
Exposures and poses are corrected on the way, if they need it (`ViewCorrections`).
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ...capture.model import View
from ...runtime.protocol import Reporter
from ..calibration.corrections import ViewCorrections
from ..calibration.poses import AlignedViews
from ..gaussians import Gaussians
from ..raster import ContrastPlan, LearningRates, Rasterizer
from ..scene_frame import SceneFrame
from ..strategy import Evidence, MultiViewConsistent, ViewEvidence
from ..strategy.editing import in_morton_order, morton_order
from ..targets import Background, TrainingView, ViewOrder, prepare_targets
from .decisions import DecisionLog, Measurement, split_views
from .evidence import gather_view_evidence
from .fitting import Fit
from .losses import GuidedLoss, KeptContrast
from .plan import TrainingPlan, TrainingResult
from .schedule import TrainingSchedule
from .start import StartChoice, StartTrial, choose_start, means_reach

__all__ = ["STAGE", "Trainer"]

STAGE = "geometry"
_PROGRESS_EVERY = 10  # steps


class Trainer:
    """One training run, started by `train`.

    Args:
        rasterizer: renders the views.
        views: training views; some may be held back for validation (`split_views`).
        held_out: views for evaluation, never fitted; may be empty.
        points, colors: (P, 3) sparse points in world units and their (P, 3) uint8 sRGB colours; P may be 0.
        plan: the settings.
        background: behind the Gaussians.
        seed: of the initialisation, the order of the views and the strategy.
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
        self._split = split_views(len(views), len(held_out), decides=plan.decides)
        fitted = [views[i] for i in self._split.fitted]
        self._prepare_views([*fitted, *(views[i] for i in self._split.validation)], held_out)
        self._fitted_count = len(fitted)
        self._limit = plan.limit or plan.growth.ceiling(sum(v.camera.width * v.camera.height for v in fitted))
        self._strategy = plan.strategy or MultiViewConsistent()
        self._schedule = TrainingSchedule(plan, self._strategy.schedule)
        start = self._choose_start(fitted, points, colors, seed)
        initial = start.gaussians.take(morton_order(start.gaussians.means))
        self._schedule.means_reach = means_reach(initial.means, [v.at(1)[1] for v in self._targets[: len(fitted)]])
        self._initial_count = len(initial)
        self.fit = Fit(rasterizer, initial.with_sh_degree(plan.sh_degree or 0), background, plan.ssim_weight)
        self._corrections = ViewCorrections(
            rasterizer, self._targets, background, plan.exposure, plan.poses, plan.steps
        )
        self._order = ViewOrder(self._fitted_count, self._rng)
        self._loss: GuidedLoss | None = None
        self._degree_undecided = plan.sh_degree is None
        self._curve: list[dict[str, float | None]] = []
        self._log = DecisionLog(self._split.reason, type(self._strategy).__name__, plan.steps, plan.limit)
        self._start = start.words

    def _choose_start(
        self, views: Sequence[View], points: NDArray[np.float32], colors: NDArray[np.uint8], seed: int
    ) -> StartChoice:
        plan, fitted, judging = self._plan, self._targets[: self._fitted_count], self._targets[self._fitted_count :]
        steps = plan.start.trial_steps(plan.steps)
        trial = StartTrial(
            *(self._rasterizer, self._background, fitted, judging, self._schedule.coarsest, steps),
            *(plan.ssim_weight, plan.learning_rates, seed),
        )
        return choose_start(plan.initial, plan.start, trial, views, points, colors, self._frame, self._limit)

    def _prepare_views(self, training: Sequence[View], held_out: Sequence[View]) -> None:
        """Targets of the views; of the training views, those that are fitted from the start come first."""
        self._keys = [view.key for view in training]
        self._targets = self._prepare(training, {factor for _, factor in self._plan.coarse})
        self._all_held_out = list(held_out)
        self._held_out = self._prepare(self._plan.curve_subset(held_out))
        split = self._split
        self._validation = self._held_out if split.validate_on_held_out else self._targets[len(split.fitted) :]
        self._aligned_validation: AlignedViews | None = None
        self._aligned_held_out: dict[str, NDArray[np.float64]] = {}

    def _prepare(self, views: Sequence[View], reductions: Collection[int] = ()) -> list[TrainingView]:
        return prepare_targets(self._rasterizer, views, self._frame, self._background, reductions)

    def train(self, reporter: Reporter) -> TrainingResult:
        """Run the planned steps, or as many as pay."""
        plan, schedule = self._plan, self._schedule
        reporter.status(STAGE, f"fitting {self._initial_count:,} Gaussians to {len(self._targets)} views")
        curve_steps = {round(plan.steps * (i + 1) / plan.curve_points) for i in range(plan.curve_points)}
        psnr = self._extend_curve(0)
        step = 0
        while step < schedule.steps:
            step += 1
            self.step(step)
            if schedule.refines(step):
                self._refine(step)
            if self._stops_early(step):
                break
            if schedule.progress(step) >= plan.validation_until:
                self._end_validation(step)
            if step in curve_steps and step < schedule.steps:
                psnr = self._extend_curve(step)
            if step % _PROGRESS_EVERY == 0:
                quality = f", {psnr:.1f} dB" if psnr is not None else ""
                reporter.progress(STAGE, step / schedule.steps, f"{len(self.fit):,} Gaussians{quality}")
        self._finish(step)
        reporter.progress(STAGE, 1.0, f"{len(self.fit):,} Gaussians")
        self._warn(step, reporter)
        decision = self._log.in_words(step, self._initial_count, self.fit) | self._corrections.in_words()
        if self._start:
            decision["start"] = self._start
        if self._aligned_held_out:
            decision["poses"] += "; the held-out views were then aligned with the finished scene"
        return TrainingResult(
            self.gaussians,
            self._curve,
            self._seconds,
            self._initial_count,
            decision,
            self.fit.skipped,
            self._moved_poses(),
        )

    @property
    def gaussians(self) -> Gaussians:
        """The current Gaussians, in world units."""
        return self._frame.to_world(self.fit.parameters.to_gaussians())

    def step(self, step: int) -> None:
        """One optimisation step, on the next view."""
        strategy, schedule = self._strategy, self._schedule
        learning_rates, growing = schedule.learning_rates(step), schedule.growing(step)
        proposed = self._corrections.decide(schedule.progress(step), self.fit.parameters)
        if proposed and self._validation:
            self._try_exposure(step)
        if self._loss is None and self._plan.contrast is not None and schedule.contrast(step):
            self._keep_contrast(self._plan.contrast)
        gather = growing and _due(strategy.gradient_every, step)
        self._fit_next(schedule.reduction(step), learning_rates, gather_gradient=gather)
        if growing and _due(strategy.perturb_every, step):
            gaussians = self.fit.parameters.to_gaussians()
            self.fit.assign(strategy.perturb(gaussians, self._plan.steps, learning_rates.means, self._rng))

    def _fit_next(
        self,
        reduction: int,
        learning_rates: LearningRates,
        *,
        gather_gradient: bool = False,
        order: ViewOrder | None = None,
    ) -> None:
        view = (order or self._order).next()
        self.fit.step(
            self._targets[view],
            reduction,
            learning_rates,
            gather_gradient=gather_gradient,
            correction=self._corrections.of(view),
            loss=None if self._loss is None else self._loss.of(view),
        )

    def _keep_contrast(self, plan: ContrastPlan) -> None:
        """From now on, add the contrast hinge to the loss, for normal vision."""
        contrast = KeptContrast(self._rasterizer, plan, ((view.at(1)[0], view.looked_at()) for view in self._targets))
        self._loss = GuidedLoss(self._rasterizer, None, self._plan.ssim_weight, 0.0, contrast)
        self._log.forget_best()  # it gives up a little PSNR for contrast

    # Densification

    def _refine(self, step: int) -> None:
        """Let the strategy densify and prune, unless the growth rule ends growth."""
        plan, strategy = self._plan, self._strategy
        if plan.limit is None and self._validation and self._schedule.at_full_resolution(step):
            self._log.rounds.append(self._measure(step))
            verdict = plan.growth.verdict(self._log.rounds)
            if verdict is not None:
                self._schedule.end_growth()
                self._log.growth = verdict
                return
        budget = strategy.schedule.budget(step, plan.steps, self._initial_count, self._limit)
        evidence = Evidence(self.fit.mean_gradient, self._sample_evidence(step))
        gaussians = self.fit.parameters.to_gaussians()
        self.fit.apply(in_morton_order(strategy.refine(gaussians, evidence, budget, self._rng)))

    def _sample_evidence(self, step: int) -> ViewEvidence | None:
        available = self._fitted_count
        wanted = self._strategy.views_wanted(step, self._plan.steps, available)
        if not wanted:
            return None
        # A census of all views decides what to remove, which fine detail does not change: low resolution is enough.
        reduction = self._schedule.coarsest if wanted == available else self._schedule.reduction(step)
        chosen = np.sort(self._rng.choice(available, wanted, replace=False))
        return self._evidence(chosen.tolist(), reduction)

    def _evidence(self, views: Sequence[int], reduction: int) -> ViewEvidence:
        return gather_view_evidence(
            self._rasterizer,
            self.fit.parameters,
            self._corrections.seen(views, reduction),
            self._background,
            complete=len(views) == self._fitted_count,
            reduction=reduction,
        )

    # Validation

    def _measure(self, step: int) -> Measurement:
        """Measure the validation views; keeps the Gaussians if they are the best so far."""
        if self._corrections.poses_were_off:
            self._align_validation()
        measurement = Measurement(step, len(self.fit), self._validation_psnr(), self.fit.work)
        self._log.keep_if_best(measurement, self.fit)
        return measurement

    def _validation_psnr(self) -> float:
        """dB; with exposures compensated if these are corrected, since the scene is kept free of them."""
        return self.fit.psnr(self._validation, any_exposure=self._corrections.exposure.active)

    def _try_exposure(self, step: int) -> None:
        """Correct exposures only if the validation views gain by it: two branches from here, on the same views."""
        plan, corrections = self._plan, self._corrections
        assert plan.exposure is not None, "only a plan proposes a correction"
        before, start = self.fit.state, self.fit.parameters.to_gaussians()
        psnr = []
        for corrected in (False, True):
            corrections.exposure.active = corrected
            self.fit.restart(start)
            order = ViewOrder(self._fitted_count, np.random.default_rng(step))
            for _ in range(plan.exposure.trial_steps(plan.steps)):
                self._fit_next(self._schedule.reduction(step), self._schedule.learning_rates(step), order=order)
            psnr.append(self.fit.psnr(self._validation, any_exposure=True))
        if not corrections.settle_exposure(psnr[1] - psnr[0]):
            self.fit.state = before  # as if there had been no trial

    def _align_validation(self) -> None:
        """Align the validation views' poses, which are off like the others, with the current scene."""
        if self._aligned_validation is None:
            self._aligned_validation = self._aligned(self._validation)
        self._aligned_validation.align(self.fit.parameters)
        self._validation = self._aligned_validation.views

    def _aligned(self, views: Sequence[TrainingView]) -> AlignedViews:
        assert self._plan.poses is not None, "poses that are not refined are never off"
        return AlignedViews(self._rasterizer, views, self._background, self._plan.poses)

    def _stops_early(self, step: int) -> bool:
        """Measure the validation views if a measurement is due, and apply the stop rule."""
        stopping = self._plan.stopping
        if stopping is None or not self._validation or not stopping.due(step, self._plan.steps):
            return False
        self._log.measured.append(self._measure(step))
        if self._schedule.growing(step) or not stopping.should_stop(self._log.measured, self._schedule.steps):
            return False
        self._log.stopped = True
        return True

    def _end_validation(self, step: int) -> None:
        """Make the decisions still open; from now on, fit the views held back for them."""
        if self._degree_undecided:
            self._choose_degree()
        if not self._split.validation:
            return
        self._validation = []
        if self._fitted_count < len(self._targets):
            if self._aligned_validation is not None:
                for view, pose in enumerate(self._aligned_validation.poses, self._fitted_count):
                    self._corrections.poses.put(view, pose)
            self._fitted_count = len(self._targets)
            self._order = ViewOrder(self._fitted_count, self._rng)
            self._log.views += f", then fitted like the others from step {step:,}"

    def _choose_degree(self) -> None:
        """Raise the SH degree as long as the validation views gain enough from it in a trial."""
        rule = self._plan.sh_degree_rule
        self._degree_undecided = False
        if not self._validation:
            return
        if not rule.trial_steps(self._plan.steps):
            self._log.degree = "the run is too short to try a higher one"
            return
        chosen = self.fit.state
        start = self.fit.parameters.to_gaussians()
        before = self._try_degree(start, 0)
        for degree in range(1, rule.highest + 1):
            after = self._try_degree(start, degree)
            self._log.degree = f"degree {degree} gained {after - before:.2f} dB in a trial"
            if after - before < rule.degree_gain:
                self._log.degree += f", less than {rule.degree_gain:g}"
                self.fit.state = chosen
                return
            before, chosen = after, self.fit.state

    def _try_degree(self, start: Gaussians, degree: int) -> float:
        """Validation PSNR after a trial of the colours, always from the same start and of the same length."""
        rule = self._plan.sh_degree_rule
        self.fit.restart(start.with_sh_degree(degree))
        steps = rule.trial_steps(self._plan.steps)
        for number in range(steps):
            self._fit_next(1, rule.learning_rates(number / steps))
        return self._validation_psnr()

    # The end of the run

    def _finish(self, step: int) -> None:
        """Restore the best Gaussians, choose the SH degree, remove what no view shows; completes the curve."""
        if self._validation and self._plan.stopping is not None:
            self._log.restore_best(self._measure(step), self.fit)
        if self._degree_undecided:
            self._choose_degree()
        views = self._evidence(range(self._fitted_count), self._schedule.coarsest)
        self.fit.keep(~views.unseen & ~views.floaters)
        if self._corrections.poses_were_off and self._all_held_out:
            self._align_held_out()
        self._extend_curve(step)

    def _align_held_out(self) -> None:
        """Align the held-out views' poses, which are off like the others, with the finished scene."""
        aligned = self._aligned(self._prepare(self._all_held_out))
        aligned.align(self.fit.parameters)
        self._aligned_held_out = {view.key: pose for view, pose in zip(self._all_held_out, aligned.poses, strict=True)}
        self._held_out = self._plan.curve_subset(aligned.views)

    def _moved_poses(self) -> dict[str, NDArray[np.float64]]:
        moved = self._corrections.moved_poses
        if moved is None:
            return {}
        poses = {**dict(zip(self._keys, moved, strict=True)), **self._aligned_held_out}
        return {key: self._frame.pose_to_world(pose) for key, pose in poses.items()}

    def _extend_curve(self, step: int) -> float | None:
        """Add a point to the curve; returns the held-out PSNR."""
        started = time.perf_counter()
        psnr = self.fit.psnr(self._held_out) if self._held_out else None
        entry = {"step": step, "psnr": psnr, "gaussians": len(self.fit)}
        if self._split.validation and self._validation:
            entry["deciding_psnr"] = self._validation_psnr()  # the name in existing reports
        if self._held_out and self._corrections.exposure.active:
            entry["psnr_any_exposure"] = self.fit.psnr(self._held_out, any_exposure=True)
        self._measuring += time.perf_counter() - started
        self._curve.append({**entry, "seconds": round(self._seconds, 2)})
        return psnr

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._started - self._measuring

    def _warn(self, steps: int, reporter: Reporter) -> None:
        if self.fit.skipped:
            reporter.warning(
                "skipped-steps",
                f"{self.fit.skipped} of {steps} steps gave numbers that are not finite and were skipped, entirely or "
                "for the Gaussians concerned",
            )
        if self._corrections.poses_were_off:
            reporter.warning(
                "cameras-corrected",
                f"the camera poses were about {self._corrections.pose_motion:.1f} pixels off and were corrected along "
                "with the scene; a better calibration may make it sharper",
            )


def _due(every: int, step: int) -> bool:
    return every > 0 and step % every == 0
