"""Fits Gaussians to photographs with known cameras: the optimisation loop, its schedule and its curve."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from ..events import Reporter
from .corrections import ViewCorrections
from .course import Course
from .decisions import Measurement, assign_views, fit_all
from .evidence import gather_view_evidence
from .fitting import Fit
from .gaussians import Gaussians
from .outcome import Outcome
from .plan import TrainingPlan, TrainingResult
from .poses import AlignedViews
from .raster import LearningRates, Rasterizer
from .scene_frame import SceneFrame
from .strategy import Evidence, MultiViewConsistent, ViewEvidence, floaters, unseen
from .strategy.ordering import in_order, morton_order
from .targets import Background, ViewOrder, prepare_targets

__all__ = ["STAGE", "Trainer"]

T = TypeVar("T")

STAGE = "geometry"
_PROGRESS_EVERY = 10  # steps


class Trainer:
    """One training run over `views`; `train` does it.

    Args:
        rasterizer: does the arithmetic.
        views: to fit, but for a few of them that decide how long and how large (`assign_views`).
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
        self._aligned: dict[str, NDArray[np.float64]] = {}
        self._aligned_deciding: AlignedViews | None = None
        self._prepare_views(views, held_out)
        fitted = [views[i] for i in self._roles.fitted]
        self._fitted = len(fitted)
        self._limit = plan.limit or plan.growth.ceiling(sum(v.camera.width * v.camera.height for v in fitted))
        self._strategy = plan.strategy or MultiViewConsistent()
        self._course = Course(plan, self._strategy.schedule)
        initial = plan.initial.make(fitted, points, colors, self._frame, self._rng, self._limit)
        initial = initial.take(morton_order(initial.means))
        self._initial = len(initial)
        self.fit = Fit(rasterizer, with_sh_degree(initial, plan.sh_degree or 0), background, plan.ssim_weight)
        self._corrections = ViewCorrections(
            rasterizer, self._targets, background, plan.exposure, plan.poses, plan.steps
        )
        self._order = ViewOrder(self._fitted, self._rng)
        self._degree_undecided = plan.sh_degree is None
        self._curve: list[dict[str, float | None]] = []
        self._decided = Outcome(self._roles.reason, type(self._strategy).__name__)

    def _prepare_views(self, views: Sequence[View], held_out: Sequence[View]) -> None:
        plan, frame, background = self._plan, self._frame, self._background
        decides = plan.stopping is not None or plan.limit is None or plan.sh_degree is None
        self._roles = assign_views(len(views), len(held_out)) if decides else fit_all(len(views))
        factors = {factor for _, factor in plan.coarse}
        # Those that are fitted from the start come first.
        training = [views[i] for i in (*self._roles.fitted, *self._roles.kept_aside)]
        self._keys = [view.key for view in training]
        self._targets = prepare_targets(self._rasterizer, training, frame, background, factors)
        self._judging = list(held_out)
        self._held_out = prepare_targets(self._rasterizer, self._shown_of(held_out), frame, background, set())
        self._deciding = self._held_out if self._roles.held_out_decide else self._targets[len(self._roles.fitted) :]

    def train(self, reporter: Reporter) -> TrainingResult:
        """Run the steps, as many as the plan's rules find worth while."""
        plan, course = self._plan, self._course
        reporter.status(STAGE, f"fitting {self._initial:,} Gaussians to {len(self._targets)} views")
        shown = {round(plan.steps * (i + 1) / plan.curve_points) for i in range(plan.curve_points)}
        psnr = self._show(0)
        step = 0
        while step < course.steps:
            step += 1
            self.step(step)
            if course.due(step):
                self._refine(step)
            if self._decide(step):
                break
            if course.progress(step) >= plan.decided:
                self._conclude(step)
            if step in shown and step < course.steps:
                psnr = self._show(step)
            if step % _PROGRESS_EVERY == 0:
                quality = f", {psnr:.1f} dB" if psnr is not None else ""
                reporter.progress(STAGE, step / course.steps, f"{len(self.fit):,} Gaussians{quality}")
        self._finish(step)
        reporter.progress(STAGE, 1.0, f"{len(self.fit):,} Gaussians")
        if self.fit.skipped:
            reporter.warning(
                "skipped-steps",
                f"{self.fit.skipped} of {step} steps met numbers that are not finite and were left out, in whole or "
                "for the Gaussians concerned",
            )
        if self._corrections.poses_were_off:
            reporter.warning(
                "cameras-corrected",
                f"the cameras were not exact, about {self._corrections.pose_motion:.1f} pixels off, and were corrected "
                "along with the scene; with a better calibration it may become sharper",
            )
        decision = self._decided.in_words(plan, step, self._initial, self.fit) | self._corrections.in_words()
        if self._aligned:
            decision["poses"] += "; held-out views were then aligned with the finished scene"
        return TrainingResult(
            self.gaussians,
            self._curve,
            self._seconds,
            self._initial,
            decision,
            self.fit.skipped,
            self._moved_poses(),
        )

    @property
    def gaussians(self) -> Gaussians:
        """As they are now, in world units."""
        return self._frame.to_world(self.fit.parameters.to_gaussians())

    def _moved_poses(self) -> dict[str, NDArray[np.float64]]:
        moved = self._corrections.moved_poses
        if moved is None:
            return {}
        poses = {**dict(zip(self._keys, moved, strict=True)), **self._aligned}
        return {key: self._frame.pose_to_world(pose) for key, pose in poses.items()}

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._started - self._measuring

    def step(self, step: int) -> None:
        """One optimisation step of the run, on the next view."""
        strategy, rates, growing = self._strategy, self._course.rates(step), self._course.growing(step)
        gather = growing and _due(strategy.gradient_every, step)
        self._corrections.decide(self._course.progress(step), self.fit.parameters)
        self._fit_next(self._course.reduction(step), rates, gather_gradient=gather)
        if growing and _due(strategy.disturb_every, step):
            gaussians = self.fit.parameters.to_gaussians()
            self.fit.put(strategy.disturb(gaussians, self._plan.steps, rates.means, self._rng))

    def _fit_next(self, reduction: int, rates: LearningRates, *, gather_gradient: bool = False) -> None:
        view = self._order.next()
        correction = self._corrections.of(view)
        self.fit.step(self._targets[view], reduction, rates, gather_gradient=gather_gradient, correction=correction)

    def _refine(self, step: int) -> None:
        """Let the strategy change the set of Gaussians, and the growth rule say whether that goes on."""
        plan, strategy = self._plan, self._strategy
        if plan.limit is None and self._deciding and self._course.fine_since(step) > 0:
            rounds = self._decided.at_round(self._measure(step))
            verdict = plan.growth.verdict(rounds)
            if verdict is not None:
                self._course.end_growth(step)
                self._decided.growth = verdict
                return
        budget = strategy.schedule.budget(step, plan.steps, self._initial, self._limit)
        evidence = Evidence(self.fit.mean_gradient, self._ask_views(step))
        gaussians = self.fit.parameters.to_gaussians()
        self.fit.apply(in_order(strategy.refine(gaussians, evidence, budget, self._rng)))

    def _ask_views(self, step: int) -> ViewEvidence | None:
        available = self._fitted
        wanted = self._strategy.views_wanted(step, self._plan.steps, available)
        if not wanted:
            return None
        # All of them are asked at the lower resolution: what they decide is what can go, which fine detail is not.
        reduction = self._course.coarsest if wanted == available else self._course.reduction(step)
        chosen = np.sort(self._rng.choice(available, wanted, replace=False))
        return self._evidence(chosen.tolist(), reduction)

    def _evidence(self, views: Sequence[int], reduction: int) -> ViewEvidence:
        return gather_view_evidence(
            self._rasterizer,
            self.fit.parameters,
            self._corrections.seen(views, reduction),
            self._background,
            complete=len(views) == self._fitted,
            reduction=reduction,
        )

    def _decide(self, step: int) -> bool:
        """Measure the deciding views when it is time to; whether the run ends here."""
        stopping = self._plan.stopping
        if stopping is None or not self._deciding or not stopping.due(step, self._plan.steps):
            return False
        self._decided.measured.append(self._measure(step))
        if self._course.growing(step) or not stopping.enough(self._decided.measured, self._course.steps):
            return False
        self._decided.stopped = step
        return True

    def _measure(self, step: int) -> Measurement:
        """What the deciding views say; keeps the Gaussians when they are the best so far."""
        if self._corrections.poses_were_off:
            self._align_deciding()
        measurement = Measurement(step, len(self.fit), self._deciding_psnr(), self.fit.work)
        self._decided.keep_if_best(measurement, self.fit)
        return measurement

    def _deciding_psnr(self) -> float:
        """dB; where exposures differ, apart from that, since a scene that gets better has none of the odd ones."""
        return self.fit.psnr(self._deciding, any_exposure=self._corrections.exposure.active)

    def _conclude(self, step: int) -> None:
        """Decide what is still open, once; the views that were kept aside for it are fitted from then on."""
        if self._degree_undecided:
            self._choose_degree()
        if self._roles.kept_aside:
            self._fit_all_views(step)

    def _align_deciding(self) -> None:
        """Bring the deciding views' poses, off as the others were, to where the scene is now."""
        if self._aligned_deciding is None:
            assert self._plan.poses is not None, "poses that are not refined are never off"
            self._aligned_deciding = AlignedViews(self._rasterizer, self._deciding, self._background, self._plan.poses)
        self._aligned_deciding.align(self.fit.parameters)
        self._deciding = self._aligned_deciding.views

    def _fit_all_views(self, step: int) -> None:
        self._deciding = []
        if self._fitted < len(self._targets):
            if self._aligned_deciding is not None:
                for view, pose in enumerate(self._aligned_deciding.poses, self._fitted):
                    self._corrections.poses.put(view, pose)
            self._fitted = len(self._targets)
            self._order = ViewOrder(self._fitted, self._rng)
            self._decided.views += f", and fitted like the others from step {step:,} on"

    def _finish(self, step: int) -> None:
        """Go back to the best Gaussians, choose the degree, remove what no view shows; ends the curve."""
        if self._deciding and self._plan.stopping is not None:
            self._decided.return_to_best(self._measure(step), self.fit)
        if self._degree_undecided:
            self._choose_degree()
        views = self._evidence(range(self._fitted), self._course.coarsest)
        self.fit.keep(~unseen(views) & ~floaters(views))
        if self._corrections.poses_were_off and self._judging:
            self._align_held_out()
        self._show(step)

    def _align_held_out(self) -> None:
        """Bring the held-out views' poses, off as the others were, to where the finished scene matches them best."""
        plan = self._plan.poses
        assert plan is not None, "poses that are not refined are never off"
        targets = prepare_targets(self._rasterizer, self._judging, self._frame, self._background, set())
        aligned = AlignedViews(self._rasterizer, targets, self._background, plan)
        aligned.align(self.fit.parameters)
        self._aligned = {view.key: pose for view, pose in zip(self._judging, aligned.poses, strict=True)}
        self._held_out = self._shown_of(aligned.views)

    def _shown_of(self, held_out: Sequence[T]) -> list[T]:
        """Those of all held-out views that the curve is measured on."""
        return list(held_out[:: max(len(held_out) // self._plan.curve_views, 1)])

    def _choose_degree(self) -> None:
        """Give the colours one more degree as long as the deciding views gain enough by it."""
        rule = self._plan.harmonics
        self._degree_undecided = False
        if not self._deciding:
            return
        if not rule.trial_steps(self._plan.steps):
            self._decided.degree = "the run is too short to try a higher one"
            return
        chosen = self.fit.state
        start = self.fit.parameters.to_gaussians()
        before = self._try_degree(start, 0)
        for degree in range(1, rule.highest + 1):
            after = self._try_degree(start, degree)
            words = f"degree {degree} gained {after - before:.2f} dB in a trial"
            if after - before < rule.degree_gain:
                self.fit.state = chosen
                self._decided.degree = f"{words}, less than {rule.degree_gain:g}"
                return
            self._decided.degree = words
            before, chosen = after, self.fit.state

    def _try_degree(self, start: Gaussians, degree: int) -> float:
        """PSNR of the deciding views after a trial of the colours: always from the same start and equally long."""
        rule = self._plan.harmonics
        self.fit.restart(with_sh_degree(start, degree))
        steps = rule.trial_steps(self._plan.steps)
        for number in range(steps):
            self._fit_next(1, rule.rates(number / steps))
        return self._deciding_psnr()

    def _show(self, step: int) -> float | None:
        """Append to the curve; returns the held-out PSNR."""
        started = time.perf_counter()
        psnr = self.fit.psnr(self._held_out) if self._held_out else None
        entry = {"step": step, "psnr": psnr, "gaussians": len(self.fit)}
        if self._roles.kept_aside and self._deciding:
            entry["deciding_psnr"] = self._deciding_psnr()
        if self._held_out and self._corrections.exposure.active:
            entry["psnr_any_exposure"] = self.fit.psnr(self._held_out, any_exposure=True)
        self._measuring += time.perf_counter() - started
        self._curve.append({**entry, "seconds": round(self._seconds, 2)})
        return psnr


def _due(every: int, step: int) -> bool:
    return every > 0 and step % every == 0


def with_sh_degree(gaussians: Gaussians, degree: int) -> Gaussians:
    """The same colours with room for the terms up to `degree`."""
    sh = np.zeros((len(gaussians), (degree + 1) ** 2, 3), np.float32)
    sh[:, : gaussians.sh.shape[1]] = gaussians.sh
    return replace(gaussians, sh=sh)
