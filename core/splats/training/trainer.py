"""Trains Gaussians on photographs with known cameras: the optimisation loop.

A run follows its `TrainingPlan`. Each step fits one view (`fitting.Fit`), at the resolution and learning rates of the
`TrainingSchedule`; every so often the `Strategy` densifies and prunes. Validation views, which are not fitted, decide
when growth and training end and which SH degree pays (`decisions`); near the end of the run they are fitted, too.
Exposures, poses and motion blur are corrected on the way, if they need it (`ViewCorrections`), and what moves is left
out.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...capture.model import View
from ...color.noise import typical_noise
from ...files.states import Restorable, SavedState, State, restore_random
from ...runtime.protocol import Reporter
from ..calibration.corrections import Proposal, ViewCorrections
from ..calibration.poses import AlignedViews
from ..gaussians import Gaussians
from ..raster import ContrastPlan, LearningRates, Rasterizer
from ..scene_frame import SceneFrame
from ..strategy import Evidence, MultiViewConsistent, Refinement
from ..strategy.editing import in_morton_order, morton_order
from ..targets import Background, TrainingView, ViewOrder, prepare_targets
from .checkpoints import Checkpoints, fingerprint, watched
from .decisions import DecisionLog, Measurement, split_views
from .dropout import dropout_share
from .evidence import EvidenceSource
from .fitting import Fit
from .losses import GuidedLoss
from .moving import MovingThings
from .outcome import conclude, found_in_views
from .plan import TrainingPlan, TrainingResult
from .rough import rough_fit
from .schedule import TrainingSchedule, due
from .start import StartChoice, StartTrial, choose_start, means_reach
from .trials import choose_degree, more_pay, try_correction
from .validation import Curve, HeldOut, Validation, curve_entry

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
        checkpoints: where the state is kept; None keeps none.
        reporter: told what a start is chosen from, which takes a while in rooms; `train` is given one, too.

    Raises (on construction):
        InputError: the checkpoint to go on from is damaged.
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
        checkpoints: Checkpoints | None = None,
        reporter: Reporter | None = None,
    ) -> None:
        self._curve, self._reporter = Curve(), reporter or Reporter()
        self._done_before = 0.0  # of the stage, before the first step
        self._rasterizer, self._plan, self._background = rasterizer, plan, background
        self._rng = np.random.default_rng(seed)
        self._frame = SceneFrame.around(views, points)
        self._split = split_views(len(views), len(held_out), decides=plan.decides)
        fitted = [views[i] for i in self._split.fitted]
        self._prepare_views([*fitted, *(views[i] for i in self._split.validation)], held_out)
        self._fitted_count = len(fitted)
        self._limit = plan.limit or plan.growth.ceiling(sum(v.camera.width * v.camera.height for v in views))
        self._strategy = strategy = plan.strategy or MultiViewConsistent()
        self._schedule = TrainingSchedule(plan, strategy.schedule)
        noise = typical_noise([view.image for view in fitted]) if plan.contrast else 0.0
        dropout = dropout_share(plan.steps, len(fitted)) if plan.decides else 0.0
        self.fit = Fit(rasterizer, Gaussians.none(), background, plan.ssim_weight, noise, dropout)
        self._step, self._ended = 0, False
        self._corrections = ViewCorrections(
            rasterizer, self._targets, background, plan.exposure, plan.poses, plan.blur, plan.steps
        )
        self._evidence = EvidenceSource(rasterizer, background, self._corrections, strategy, self._schedule, plan.steps)
        self._moving = MovingThings(rasterizer, background, plan, self._targets, self._fitted_count, self._validation)
        self._order = ViewOrder(self._fitted_count, self._rng)
        self._loss: GuidedLoss | None = None
        self._degree_undecided = plan.sh_degree is None
        self._log = DecisionLog(self._split.reason, type(self._strategy).__name__, plan.steps, plan.limit)
        self._checkpoints = checkpoints
        saved = checkpoints and checkpoints.saved(fingerprint(plan, seed, views, held_out, points, colors))
        if saved:
            self._restore(saved)
        else:
            self._begin(self._choose_start(fitted, points, colors, seed))

    def _begin(self, start: StartChoice) -> None:
        plan, initial = self._plan, start.gaussians.take(morton_order(start.gaussians.means))
        cameras = [view.at(1)[1] for view in self._targets[: self._fitted_count]]
        self._schedule.means_reach = means_reach(initial.means, cameras) * start.means_rate
        self._log.initial, self._log.start = len(initial), start.words
        self.fit.restart(initial.with_sh_degree(plan.sh_degree or 0))

    def _choose_start(
        self, views: Sequence[View], points: NDArray[np.float32], colors: NDArray[np.uint8], seed: int
    ) -> StartChoice:
        plan, fitted, few = self._plan, self._targets[: self._fitted_count], not self._split.validation
        reach = means_reach(self._frame.points(points), [view.at(1)[1] for view in fitted])
        # Of few views, only short runs gain by more than sparse points: in long ones, what grows slowly overfits less.
        judging = self._validation.views if plan.is_short(reach) or not few else []
        trial = StartTrial(
            *(self._rasterizer, self._background, fitted, judging, self._schedule.coarsest),
            *(plan.start.trial_steps(plan.steps), plan.ssim_weight, plan.learning_rates, seed, self.fit.noise),
            *(partial(self._reporter.status, STAGE), not few),
        )

        def train(small: Sequence[View], rough_plan: TrainingPlan, reporter: Reporter) -> Gaussians:
            trainer = Trainer(self._rasterizer, small, [], points, colors, rough_plan, self._background, seed)
            return trainer.train(reporter).gaussians

        rough = None if few else rough_fit(plan, reach, views, self._background, train, self._reporter, STAGE)
        self._done_before = rough.share if rough and trial.possible else 0.0
        return choose_start(plan.initial, plan.start, trial, views, points, colors, self._frame, self._limit, rough)

    def _prepare_views(self, training: Sequence[View], held_out: Sequence[View]) -> None:
        """Targets of the views; of the training views, those that are fitted from the start come first."""
        split, self._keys = self._split, [view.key for view in training]
        self._targets = self._prepare(training, {factor for _, factor in self._plan.coarse})
        self._held_out = HeldOut(held_out, self._prepare, self._plan.curve_subset)
        validating = self._held_out.shown if split.validate_on_held_out else self._targets[len(split.fitted) :]
        self._validation = Validation(validating, self._aligned)

    def _prepare(self, views: Sequence[View], reductions: Collection[int] = ()) -> list[TrainingView]:
        return prepare_targets(self._rasterizer, views, self._frame, self._background, reductions)

    def train(self, reporter: Reporter) -> TrainingResult:
        """Run the planned steps, or as many as pay."""
        plan, schedule = self._plan, self._schedule
        reporter.scene(lambda: self.gaussians)
        goes_on = f", from step {self._step:,} on" if self._step else ""
        reporter.status(STAGE, f"fitting {len(self.fit):,} Gaussians to {len(self._targets)} views{goes_on}")
        curve_steps = {round(plan.steps * (i + 1) / plan.curve_points) for i in range(plan.curve_points)}
        if not self._step:
            self._extend_curve(0)
        with watched(self._checkpoints) as between_steps:
            while self._step < schedule.steps and not self._ended:
                self._step = step = self._step + 1
                self.step(step)
                if schedule.refines(step):
                    self._refine(step)
                self._ended = self._stops_early(step)
                if not self._ended and schedule.progress(step) >= plan.validation_ends:
                    self._end_validation(step)
                if not self._ended and step in curve_steps and step < schedule.steps:
                    self._extend_curve(step)
                if step % _PROGRESS_EVERY == 0:
                    psnr = self._curve.entries[-1]["psnr"]
                    quality = f", {psnr:.1f} dB" if psnr is not None else ""
                    reporter.progress(STAGE, self._done, f"{len(self.fit):,} Gaussians{quality}")
                between_steps(self._snapshot, self._ended or step == schedule.steps)
        self._finish(self._step)
        reporter.progress(STAGE, 1.0, f"{len(self.fit):,} Gaussians")
        decision = self._log.in_words(self._step, self.fit) | conclude(
            *(reporter, self._step, self.fit, self._corrections, self._moving), aligned=bool(self._held_out.poses)
        )
        measured = self._curve.entries, self._curve.seconds, self._log.initial
        found = found_in_views(self._corrections, self._moving, self._keys, self._held_out, self._frame)
        by_held_out = self._split.validate_on_held_out
        return TrainingResult(self.gaussians, *measured, decision, self.fit.skipped, *found, by_held_out)

    @property
    def _done(self) -> float:
        return self._done_before + (1.0 - self._done_before) * self._step / self._schedule.steps

    @property
    def gaussians(self) -> Gaussians:
        """The current Gaussians, in world units."""
        return self._frame.to_world(self.fit.parameters.to_gaussians())

    def step(self, step: int) -> None:
        """One optimisation step, on the next view."""
        strategy, schedule = self._strategy, self._schedule
        learning_rates, growing = schedule.learning_rates(step), schedule.growing(step)
        report = partial(self._reporter.progress, STAGE, self._done)
        for proposal in self._corrections.decide(schedule.progress(step), self.fit.parameters, report):
            if self._validation:
                self._try(proposal, step)
        if self._moving.look_if_due(step, schedule, self.fit.parameters, self._corrections):
            self._log.forget_best()
        if self._loss is None and self._plan.contrast is not None and schedule.contrast(step):
            self._loss = self._contrast_loss(self._plan.contrast)
            self._log.forget_best()  # it gives up a little PSNR for contrast
        gather = growing and due(strategy.gradient_every, step)
        self._fit_next(schedule.reduction(step), learning_rates, gather_gradient=gather)
        if growing and due(strategy.perturb_every, step):
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

    def _contrast_loss(self, plan: ContrastPlan) -> GuidedLoss:
        return GuidedLoss.of_photographs(self._rasterizer, self._targets, self._plan.ssim_weight, plan, self.fit.noise)

    # Densification

    def _refine(self, step: int) -> None:
        """Let the strategy densify and prune, unless the growth rule ends growth."""
        plan = self._plan
        if plan.limit is None and self._validation and self._schedule.at_full_resolution(step):
            self._log.rounds.append(self._measure(step))
            verdict = plan.growth.verdict(self._log.rounds)
            removes = self._evidence.is_census(step, self._fitted_count)  # so that nothing can be tried
            if verdict is not None and not removes:
                grown, branch = self._refinement(step).gaussians, partial(self._growth_branch, step)
                pays, words = more_pay(self.fit, plan.growth, plan.steps, grown, branch)
                self._log.rounds.clear()  # where it pays, asked again after as many rounds as a verdict needs
                if not pays:
                    self._schedule.end_growth()
                    self._log.growth = f"{verdict}, and {words}" if words else verdict
                return
        self.fit.apply(self._refinement(step))

    def _growth_branch(self, step: int, steps: int) -> tuple[float, float]:
        self._fit_trial(step, steps)
        return self._validation_psnr(), self.fit.contrast(self._validation.views)

    def _fit_trial(self, step: int, steps: int) -> None:
        """Fit `steps` views as at `step`, the same ones in each branch of a trial."""
        order = ViewOrder(self._fitted_count, np.random.default_rng(step))
        for _ in range(steps):
            self._fit_next(self._schedule.reduction(step), self._schedule.learning_rates(step), order=order)

    def _refinement(self, step: int) -> Refinement:
        budget = self._strategy.schedule.budget(step, self._plan.steps, self._log.initial, self._limit)
        views = self._evidence.sampled(step, self._fitted_count, self.fit.parameters, self._rng)
        evidence = Evidence(self.fit.mean_gradient if self._strategy.gradient_every else None, views)
        gaussians = self.fit.parameters.to_gaussians()
        return in_morton_order(self._strategy.refine(gaussians, evidence, budget, self._rng))

    # Validation

    def _measure(self, step: int) -> Measurement:
        """Measure the validation views; keeps the Gaussians if they are the best so far."""
        self._validation.follow(self.fit, self._corrections)
        measurement = Measurement(step, len(self.fit), self._validation_psnr(), self.fit.work)
        self._log.keep_if_best(measurement, self.fit)
        return measurement

    def _validation_psnr(self) -> float:
        """dB; with exposures compensated if these are corrected, since the scene is kept free of them."""
        return self.fit.psnr(self._validation.views, any_exposure=self._corrections.exposure.active)

    def _try(self, proposal: Proposal, step: int) -> None:
        """Correct only if the validation views gain by it: two branches from here, on the same views."""
        validation, of_poses = self._validation, proposal is Proposal.POSES

        def branch(corrected: bool) -> float:
            self._corrections.switch(proposal, corrected)
            if of_poses and corrected and self._corrections.match_poses(self.fit.parameters):
                self.fit.restart(self._plan.initial.again(self.fit.parameters.to_gaussians()))
            self._fit_trial(step, self._corrections.trial_steps(proposal))
            views = validation.matched(self.fit.parameters, self._schedule.coarsest) if of_poses else validation.views
            views = self.fit.smeared(views) if proposal is Proposal.BLUR else views
            return self.fit.psnr(views, any_exposure=True)

        if try_correction(self.fit, branch, partial(self._corrections.settle, proposal)):
            if of_poses:
                self._corrections.match_poses(self.fit.parameters)
            elif proposal is Proposal.BLUR:
                self._log.forget_best()  # measured through lines from now on

    def _aligned(self, views: Sequence[TrainingView]) -> AlignedViews:
        assert self._plan.poses is not None, "poses that are not refined are never off"
        return AlignedViews(self._rasterizer, views, self._background, self._plan.poses)

    def _stops_early(self, step: int) -> bool:
        """Measure the validation views if that is due, and apply the stop rule; the hinge still gets its part."""
        plan, log = self._plan, self._log
        if plan.stopping is None or not self._validation or not plan.stopping.due(step, plan.steps):
            return False
        log.measured.append(self._measure(step))
        settled = self._loss is None and not self._schedule.growing(step)
        if not settled or not plan.stopping.should_stop(log.measured, plan.steps):
            return False
        log.stopped = True
        if plan.contrast is not None:
            log.restore_best(log.measured[-1], self.fit)
            self._schedule.skip_to_contrast(step)
        return plan.contrast is None

    def _end_validation(self, step: int) -> None:
        """Make the decisions still open; from now on, fit the views held back for them."""
        if self._degree_undecided:
            self._choose_degree()
        if not self._split.validation:
            return
        self._validation.end()
        if self._fitted_count < len(self._targets):
            self._corrections.admit(self._fitted_count, self._validation.poses, self.fit.parameters)
            self._fitted_count = len(self._targets)
            self._order = ViewOrder(self._fitted_count, self._rng)
            self._log.views += f", then fitted like the others from step {step:,}"

    def _choose_degree(self) -> None:
        self._degree_undecided = False
        if self._validation:
            rule, fit_next = self._plan.sh_degree_rule, partial(self._fit_next, 1)
            self._log.degree = choose_degree(self.fit, rule, self._plan.steps, fit_next, self._validation_psnr)

    # The end of the run

    def _finish(self, step: int) -> None:
        """Restore the best Gaussians, choose the SH degree, remove what no view shows; completes the curve."""
        if self._validation and self._plan.stopping is not None:
            self._log.restore_best(self._measure(step), self.fit)
        if self._degree_undecided:
            self._choose_degree()
        views = self._evidence.all(self._fitted_count, self.fit.parameters)
        self.fit.keep(~views.unseen & ~views.floaters)
        if self._corrections.poses_were_off:
            self._held_out.align(self.fit.parameters, self._aligned)
        if self._corrections.blur.active:
            self._held_out.smear(self.fit.best_line)
        self._extend_curve(step)

    def _extend_curve(self, step: int) -> None:
        shown, corrections = self._held_out.shown, self._corrections
        deciding = self._validation.views if self._split.validation else ()
        suited = {"any_exposure": corrections.exposure.active, "any_blur": corrections.blur.active}
        self._curve.extend(lambda: curve_entry(self.fit, step, shown, deciding, **suited))

    # Checkpoints

    def _snapshot(self) -> State:
        """Everything that changes while a run goes on, between two steps."""
        return {
            **{name: part.snapshot() for name, part in self._parts().items()},
            "step": self._step,
            "ended": self._ended,
            "all_fitted": self._fitted_count == len(self._targets),
            "degree_undecided": self._degree_undecided,
            "contrast": self._loss is not None,
            "random": self._rng.bit_generator.state,
        }

    def _parts(self) -> dict[str, Restorable]:
        return {
            "moving": self._moving,  # first: it changes views that others are of
            "fit": self.fit,
            "corrections": self._corrections,
            "order": self._order,
            "schedule": self._schedule,
            "log": self._log,
            "validation": self._validation,
            "curve": self._curve,
        }

    def _restore(self, saved: SavedState) -> None:
        """Go on from a snapshot of the same run."""
        self._step, self._ended = saved.number("step", 1, self._plan.steps), saved.value("ended", bool)
        self._degree_undecided = saved.value("degree_undecided", bool)
        if saved.value("all_fitted", bool):
            self._fitted_count = len(self._targets)
            self._order = ViewOrder(self._fitted_count, self._rng)
        for name, part in self._parts().items():
            part.restore(saved.part(name))
        if saved.value("contrast", bool) and self._plan.contrast is not None:
            self._loss = self._contrast_loss(self._plan.contrast)
        restore_random(self._rng, saved, "random")
