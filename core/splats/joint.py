"""Geometry and colours fitted together to enhanced views, as Hu and Xiao (2026) do (Eq. 7-9).

The first part of the run is the ordinary training, on enhanced instead of original photographs. Its geometry tells
which pixels of the views show the same point; in the last part the multi-view loss on those pixels is added, and shape
and colour move together at the small steps with which the first part ended.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from ..events import Reporter, StageSpan
from .fitting import Fit
from .gaussians import Gaussians
from .guides import GuidedLoss, ViewGuide
from .plan import TrainingPlan, TrainingResult
from .raster import LearningRates, Rasterizer
from .renderer import SceneRenderer
from .scene_frame import SceneFrame
from .targets import Background, ViewOrder, prepare_targets
from .trainer import STAGE, Trainer

GuidesOfGeometry = Callable[[Gaussians], Sequence[ViewGuide] | None]
"""What the views say about each other, given the geometry by which their pixels correspond; None for no guides."""


@dataclass(frozen=True)
class JointPlan:
    """The last part of a joint training.

    Attributes:
        share: of the steps that have the multi-view loss.
        multi_view_weight: λ_mv.
        rates: step sizes, in frame units where they are lengths: those that `TrainingPlan` ends with.
        rates_decay: what is left of them at the end, reached exponentially.
    """

    share: float = 0.3
    multi_view_weight: float = 1.0
    rates: LearningRates = field(
        default_factory=lambda: LearningRates(
            means=1.3e-5, log_scales=4e-3, quaternions=8e-4, opacity_logits=2e-2, sh0=2e-3, sh_rest=1e-4
        )
    )
    rates_decay: float = 0.2


@dataclass(frozen=True)
class JointTraining:
    """One joint training.

    Attributes:
        rasterizer: does the arithmetic.
        views: to fit, with enhanced images.
        held_out: to measure on, with enhanced images; may be empty.
        plan: of the whole run; its steps are divided between the two parts.
        joint: of the last part.
        background: what is behind the Gaussians.
        seed: of everything random.
    """

    rasterizer: Rasterizer
    views: Sequence[View]
    held_out: Sequence[View]
    plan: TrainingPlan
    joint: JointPlan
    background: Background
    seed: int

    def train(
        self,
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
        guides_of: GuidesOfGeometry,
        reporter: Reporter,
    ) -> TrainingResult:
        """Train from (P, 3) sparse points in world units with (P, 3) uint8 sRGB colours; P may be 0.

        Returns:
            Gaussians in enhanced colours. The curve's PSNR is against the enhanced held-out views.
        """
        together = round(self.plan.steps * self.joint.share)
        before = max(self.plan.steps - together, 1)
        plan = replace(self.plan, steps=before, poses=None)  # where the views agree is looked up with those given
        trainer = Trainer(self.rasterizer, self.views, self.held_out, points, colors, plan, self.background, self.seed)
        turn = before / self.plan.steps
        result = trainer.train(StageSpan(reporter, STAGE, 0.0, turn, "fitting enhanced views"))
        started = time.perf_counter()
        guides = guides_of(result.gaussians)
        span = StageSpan(reporter, STAGE, turn, 1.0, "agreeing")
        gaussians, skipped = self._agree(result.gaussians, guides, together, span)
        seconds = round(result.seconds + time.perf_counter() - started, 2)
        entry = {
            "step": (result.curve[-1]["step"] or 0) + together,
            "seconds": seconds,
            "psnr": self._psnr(gaussians),
            "gaussians": len(gaussians),
        }
        return replace(
            result,
            gaussians=gaussians,
            curve=[*result.curve, entry],
            seconds=seconds,
            skipped=result.skipped + skipped,
        )

    def _agree(
        self, gaussians: Gaussians, guides: Sequence[ViewGuide] | None, steps: int, reporter: Reporter
    ) -> tuple[Gaussians, int]:
        """The steps with the multi-view loss; also returns how many of them were skipped."""
        frame = SceneFrame.around(self.views, gaussians.means)
        fit = Fit(self.rasterizer, frame.from_world(gaussians), self.background, self.plan.ssim_weight)
        targets = prepare_targets(self.rasterizer, self.views, frame, self.background, set())
        loss = GuidedLoss(self.rasterizer, guides, self.plan.ssim_weight, self.joint.multi_view_weight)
        order = ViewOrder(len(targets), np.random.default_rng(self.seed))
        for step in range(1, steps + 1):
            view = order.next()
            rates = self.joint.rates.scaled(self.joint.rates_decay ** (step / steps))
            fit.step(targets[view], 1, rates, loss=loss.of(view))
            reporter.progress(STAGE, step / steps)
        return frame.to_world(fit.parameters.to_gaussians()), fit.skipped

    def _psnr(self, gaussians: Gaussians) -> float | None:
        if not self.held_out:
            return None
        shown = self.held_out[:: max(len(self.held_out) // self.plan.curve_views, 1)]
        scene = SceneRenderer(self.rasterizer, shown, self.background)
        return float(np.mean([scene.fidelity(i, scene.color(gaussians, i))["psnr"] for i in range(len(shown))]))
