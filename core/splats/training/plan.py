"""The settings of a training run (`TrainingPlan`), and its result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..calibration.exposure import ExposurePlan
from ..calibration.motion_blur import MotionBlurPlan
from ..calibration.poses import PosePlan
from ..calibration.trial_plan import TrialPlan
from ..gaussians import Gaussians
from ..raster import ContrastPlan, LearningRates
from ..strategy import Strategy
from .decisions import GrowthRule, ShDegreeRule, StopRule
from .initialise import InitialGaussians
from .rough import RoughScene
from .start import StartRule

T = TypeVar("T")
_CORRECTED_BY = 0.25  # of the run: corrections have been tried
Region = NDArray[np.bool_]
"""(H, W) of a view's image: what moves."""


def _geometry_contrast() -> ContrastPlan:
    # Every difference counts, to its full size; half as much against what the photographs do not show.
    return ContrastPlan(weight=1.0, listed=0.0, threshold=5.0, cap=math.inf, invented=0.5)


@dataclass(frozen=True)
class MovingPlan(TrialPlan):
    """When and how things that move are looked for. Residuals are means over channels of sRGB values in [0, 1].

    Attributes:
        looks: fractions of the run after which to look.
        outlying: of a view's median residual, how many times that a suspected pixel differs by.
        belonging: likewise of the pixels around that belong to it.
        agreeing: how many times their own median residual witnesses may differ by at the same place (median over them).
        floor: least median residual, so that a scene that fits all but perfectly suspects no noise.
        witnesses: views asked about each view, evenly spread; a pixel needs `fewest_witnesses` that see its place.
        same_depth: relative difference of depths up to which two views see the same place.
        least_area: share of the photograph that something which moves takes at least.
        smooth: width of the window that residuals are averaged over, in pixels.
        margin: around what was found, as a share of the longer side.
        trial: share of the run's steps in each branch of a trial, at least `fewest_trial_steps`.
        least_gain: dB that the validation views have to gain in it. So short a fit hardly mends what has been spoilt,
            so it is enough if nothing is lost, up to noise.
    """

    looks: tuple[float, ...] = (0.25, 0.4, 0.6)
    outlying: float = 18.0
    belonging: float = 5.0
    agreeing: float = 4.0
    floor: float = 0.01
    witnesses: int = 16
    fewest_witnesses: int = 3
    same_depth: float = 0.05
    least_area: float = 0.004
    smooth: int = 3
    margin: float = 0.012
    trial: float = 0.04
    fewest_trial_steps: int = 100
    least_gain: float = -0.02


@dataclass(frozen=True)
class TrainingPlan:
    """The settings of a training run; the defaults are the same for every scene.

    Attributes:
        steps: optimisation steps, on one view each; fewer if `stopping` ends the run.
        limit: largest number of Gaussians; None lets `growth` decide.
        sh_degree: of the colours; terms above 0 start at zero. None lets `sh_degree_rule` decide.
        ssim_weight: λ of the photometric loss (1 - λ) L1 + λ (1 - SSIM).
        learning_rates: initial ones, in frame units where they are lengths; about four times those of 3DGS, whose runs
            are six times as long.
        means_lr_final_factor, lr_final_factor: factors of the learning rates of the means and of all others at the end,
            reached exponentially.
        coarse: (fraction of the run, factor) pairs: until then the photographs are reduced by the factor.
        initial: how the Gaussians are initialised.
        start: whether dense stereo adds to them.
        rough: when a rough scene takes their place; None for never.
        strategy: of densification; None takes `MultiViewConsistent`.
        growth: when there are enough Gaussians.
        stopping: early stopping; None runs all steps.
        sh_degree_rule: when a higher SH degree pays.
        validation_until: fraction of the run at which validation ends: the SH degree is chosen, and training views held
            back for validation are fitted like the others, so as to leave no gap where they are.
        short_run: steps below which validation ends as soon as corrections have been tried: in a run that is as short,
            the photographs are worth more than what they decide.
        exposure: how photographs of different exposure or white balance are corrected; None to leave them.
        poses: how bad poses are refined; None to leave them. Validation views are then aligned with the scene before
            they are measured.
        blur: how motion blur is kept out of the scene; None to leave it in.
        moving: how things that move are left out; None leaves them in.
        contrast: hinge that brings back weak contrast in the last part of the run; None leaves it out, and counts noise
            as detail.
        contrast_from: fraction of the run from which it counts.
        curve_points: measurements on the held-out views.
        curve_views: views in each of them, about.
    """

    steps: int = 5000
    limit: int | None = None
    sh_degree: int | None = 0
    ssim_weight: float = 0.4
    learning_rates: LearningRates = field(
        default_factory=lambda: LearningRates(
            means=6.4e-4, log_scales=2e-2, quaternions=4e-3, opacity_logits=1e-1, sh0=1e-2, sh_rest=5e-4
        )
    )
    means_lr_final_factor: float = 0.02
    lr_final_factor: float = 0.2
    coarse: tuple[tuple[float, int], ...] = ((0.2, 2),)
    initial: InitialGaussians = field(default_factory=InitialGaussians)
    start: StartRule = field(default_factory=StartRule)
    rough: RoughScene | None = field(default_factory=RoughScene)
    strategy: Strategy | None = None
    growth: GrowthRule = field(default_factory=GrowthRule)
    stopping: StopRule | None = field(default_factory=StopRule)
    sh_degree_rule: ShDegreeRule = field(default_factory=ShDegreeRule)
    validation_until: float = 0.9
    short_run: int = 400
    exposure: ExposurePlan | None = field(default_factory=ExposurePlan)
    poses: PosePlan | None = field(default_factory=PosePlan)
    blur: MotionBlurPlan | None = field(default_factory=MotionBlurPlan)
    moving: MovingPlan | None = field(default_factory=MovingPlan)
    contrast: ContrastPlan | None = field(default_factory=_geometry_contrast)
    contrast_from: float = 0.8
    curve_points: int = 10
    curve_views: int = 6

    @property
    def decides(self) -> bool:
        """Whether anything is left for validation views to decide."""
        return self.stopping is not None or self.limit is None or self.sh_degree is None

    @property
    def validation_ends(self) -> float:
        """Fraction of the run at which validation ends."""
        return self.validation_until if self.steps >= self.short_run else min(_CORRECTED_BY, self.validation_until)

    def is_short(self, reach: float) -> bool:
        """Whether a run is too short for its scene: `RoughScene.visits`; `reach` is the `means_reach` of its points."""
        return self.rough is not None and self.rough.steps_before(self.steps, reach) > 0

    def learning_rates_at(self, progress: float, means_reach: float = 1.0) -> LearningRates:
        """The learning rates at the fraction `progress` of the run; that of the means times `means_reach`."""
        rest = self.learning_rates.scaled(self.lr_final_factor**progress)
        return replace(rest, means=self.learning_rates.means * means_reach * self.means_lr_final_factor**progress)

    def curve_subset(self, held_out: Sequence[T]) -> list[T]:
        """The held-out views on which the curve is measured, about `curve_views` of them."""
        return list(held_out[:: max(len(held_out) // self.curve_views, 1)])


@dataclass(frozen=True)
class TrainingResult:
    """The result of a training run.

    Attributes:
        gaussians: in world units.
        curve: one entry per measurement: step, seconds, psnr (held-out, dB; None without such views), gaussians;
            deciding_psnr if training views were held back for validation; psnr_any_exposure (held-out, with each
            photograph's exposure compensated) if exposures were corrected; and psnr_any_blur (with renderings smeared
            as their photographs are) if motion blur was. The last entry is that of `gaussians`.
        seconds: of the loop and its preparation, without the measurements for the curve.
        initial: number of Gaussians at the start.
        decision: automatic decisions and their reasons in plain words: views, strategy, start, gaussians, steps,
            sh_degree, restored, exposure, poses, motion_blur, moving, noise, dropout; without those that do not apply.
        skipped: steps skipped, entirely or for some Gaussians, because of non-finite numbers.
        moved_poses: (4, 4) world-to-camera by view key, if poses were refined. Held-out views are then aligned with
            the finished scene, which is not fitted to them.
        smears: `View.smear` by view key, if motion blur was kept out of the scene; those of held-out views suit the
            finished scene.
        moving: by view key, what of a training view moves and was left out.
        decided_on_held_out: whether the held-out views, on which the run is judged, made its decisions too, because
            training views were too few to hold some back.
    """

    gaussians: Gaussians
    curve: list[dict[str, float | None]]
    seconds: float
    initial: int
    decision: dict[str, Any] = field(default_factory=dict)
    skipped: int = 0
    moved_poses: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    smears: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    moving: dict[str, Region] = field(default_factory=dict)
    decided_on_held_out: bool = False
