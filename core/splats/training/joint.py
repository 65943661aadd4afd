"""Geometry and colours fitted together to enhanced views, as Hu and Xiao (2026) do (Eq. 7-9).

The first part of the run is ordinary training, on enhanced instead of original photographs. Its geometry shows which
pixels of the views correspond, and it finds what moves; the last part leaves that out, adds the multi-view loss on
corresponding pixels, and fits shapes and colours together at the low learning rates with which the first part ended.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...capture.model import View
from ...color.noise import typical_noise
from ...runtime.protocol import Reporter, StageSpan
from ..gaussians import Gaussians
from ..raster import LearningRates, Rasterizer
from ..renderer import SceneRenderer
from ..targets import Background
from .checkpoints import Checkpoints
from .fitting import fit_guided
from .losses import GuidedLoss, KeptContrast, SeenContrast, ViewGuide
from .plan import TrainingPlan, TrainingResult
from .trainer import STAGE, Trainer

GuidesOfResult = Callable[[TrainingResult], Sequence[ViewGuide] | None]
"""Guides of the views from what the first part gave, by whose geometry their pixels correspond; None for no guides."""


@dataclass(frozen=True)
class JointPlan:
    """The last part of a joint training.

    Attributes:
        share: of the steps, with the multi-view loss.
        multi_view_weight: λ_mv.
        learning_rates: initial ones, in frame units where they are lengths: those at the end of `TrainingPlan`.
        lr_final_factor: factor of the learning rates at the end, reached exponentially.
    """

    share: float = 0.3
    multi_view_weight: float = 1.0
    learning_rates: LearningRates = field(
        default_factory=lambda: LearningRates(
            means=1.3e-5, log_scales=4e-3, quaternions=8e-4, opacity_logits=2e-2, sh0=2e-3, sh_rest=1e-4
        )
    )
    lr_final_factor: float = 0.2


@dataclass(frozen=True)
class JointTraining:
    """One joint training.

    Attributes:
        rasterizer: renders the views.
        views: to fit, with enhanced images.
        held_out: for evaluation, with enhanced images; may be empty.
        plan: of the whole run, whose steps are split between the two parts.
        joint: of the last part.
        background: behind the Gaussians.
        seed: of all random numbers.
        contrast: of `views`, to keep in the last part.
        checkpoints: of the first part; None keeps none.
    """

    rasterizer: Rasterizer
    views: Sequence[View]
    held_out: Sequence[View]
    plan: TrainingPlan
    joint: JointPlan
    background: Background
    seed: int
    contrast: SeenContrast | None = None
    checkpoints: Checkpoints | None = None

    def train(
        self, points: NDArray[np.float32], colors: NDArray[np.uint8], guides_of: GuidesOfResult, reporter: Reporter
    ) -> TrainingResult:
        """Train from (P, 3) sparse points in world units with (P, 3) uint8 sRGB colours; P may be 0.

        Returns:
            Gaussians in enhanced colours. The curve's PSNR is against the enhanced held-out views.
        """
        joint = self.joint
        together = round(self.plan.steps * joint.share)
        before = max(self.plan.steps - together, 1)
        plan = replace(self.plan, steps=before, poses=None)  # `guides_of` finds correspondences in the given poses
        turn = before / self.plan.steps
        span = StageSpan(reporter, STAGE, 0.0, turn, "fitting enhanced views", tells_status=True)
        trainer = Trainer(
            *(self.rasterizer, self.views, self.held_out, points, colors, plan, self.background, self.seed),
            checkpoints=self.checkpoints,
            reporter=span,
        )
        result = trainer.train(span)
        started = time.perf_counter()
        guides = guides_of(result)
        kept = None
        if self.contrast is not None:
            photographs = [_still(view, result) for view in self.contrast.photographs]
            kept = KeptContrast.of(self.rasterizer, replace(self.contrast, photographs=photographs), self.background)
        span = StageSpan(reporter, STAGE, turn, 1.0, "making the views agree")
        noise = typical_noise([view.image for view in self.views])
        gaussians, skipped = fit_guided(
            self.rasterizer,
            result.gaussians,
            [replace(_still(view, result), smear=result.smears.get(view.key)) for view in self.views],
            self.background,
            GuidedLoss(self.rasterizer, guides, self.plan.ssim_weight, joint.multi_view_weight, kept, noise),
            lambda done: joint.learning_rates.scaled(joint.lr_final_factor**done),
            together,
            self.seed,
            partial(span.progress, STAGE),
            watch=span.scene,
        )
        seconds = round(result.seconds + time.perf_counter() - started, 2)
        entry = {
            "step": (result.curve[-1]["step"] or 0) + together,
            "seconds": seconds,
            "psnr": self._psnr(gaussians),
            "gaussians": len(gaussians),
        }
        return replace(
            result, gaussians=gaussians, curve=[*result.curve, entry], seconds=seconds, skipped=result.skipped + skipped
        )

    def _psnr(self, gaussians: Gaussians) -> float | None:
        if not self.held_out:
            return None
        shown = self.plan.curve_subset(self.held_out)
        scene = SceneRenderer(self.rasterizer, shown, self.background)
        return float(np.mean([scene.fidelity(i, scene.color(gaussians, i))["psnr"] for i in range(len(shown))]))


def _still(view: View, result: TrainingResult) -> View:
    """The view without what moves in it."""
    return view.without(result.moving[view.key]) if view.key in result.moving else view
