"""What shapes a training run, and what it hands back."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .decisions import GrowthRule, HarmonicsRule, StopRule
from .exposure import ExposurePlan
from .gaussians import Gaussians
from .initialise import InitialGaussians
from .poses import PosePlan
from .raster import LearningRates
from .strategy import Strategy


@dataclass(frozen=True)
class TrainingPlan:
    """Everything that shapes a training run; the same for every scene.

    Attributes:
        steps: optimisation steps, one view each; at most so many where `stopping` ends the run.
        limit: most Gaussians; None lets `growth` decide.
        sh_degree: of the colours; terms above 0 start at zero. None lets `harmonics` decide.
        ssim_weight: λ of (1 - λ) L1 + λ (1 - SSIM).
        rates: step sizes at the start, in frame units where they are lengths; about four times those of 3DGS,
            whose runs are six times as long.
        means_decay, rates_decay: what is left of the step sizes at the end, reached exponentially.
        coarse: (fraction of the run, factor) pairs: until then the photographs are reduced by the factor.
        initial: how the first Gaussians are made.
        strategy: how their set changes; None takes `MultiViewConsistent`.
        growth: when there are enough Gaussians.
        stopping: when there were enough steps; None runs them all.
        harmonics: when a higher SH degree pays.
        decided: fraction of the run after which all is decided: the SH degree is chosen then, and the views that were
            kept aside to decide are fitted like the others, which no longer leaves a gap where they stand.
        exposure: how photographs that differ in exposure or white balance are corrected; None leaves them.
        poses: how poses that are off are corrected; None leaves them. Views that decide are then aligned with the
            scene before they are measured.
        curve_points: how often held-out views are measured.
        curve_views: at most so many of them each time.
    """

    steps: int = 5000
    limit: int | None = None
    sh_degree: int | None = 0
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
    strategy: Strategy | None = None
    growth: GrowthRule = field(default_factory=GrowthRule)
    stopping: StopRule | None = field(default_factory=StopRule)
    harmonics: HarmonicsRule = field(default_factory=HarmonicsRule)
    decided: float = 0.9
    exposure: ExposurePlan | None = field(default_factory=ExposurePlan)
    poses: PosePlan | None = field(default_factory=PosePlan)
    curve_points: int = 10
    curve_views: int = 6

    def rates_at(self, progress: float) -> LearningRates:
        """The step sizes when the fraction `progress` of the run is done: exponential from the start's to the end's."""
        rest = self.rates.scaled(self.rates_decay**progress)
        return replace(rest, means=self.rates.means * self.means_decay**progress)


@dataclass(frozen=True)
class TrainingResult:
    """What training gave.

    Attributes:
        gaussians: in world units.
        curve: one entry a measurement: step, seconds, psnr (held-out, dB; None without such views), gaussians, and
            deciding_psnr where other views than the held-out ones decide, and psnr_any_exposure (held-out, each
            rendering with its photograph's exposure) where exposures were corrected. The last entry is that of
            `gaussians`.
        seconds: of the loop and its preparation, without the measurements for the curve.
        initial: Gaussians at the start.
        decision: in plain words, what was decided by itself and why: views, strategy, gaussians, steps, sh_degree,
            exposure, poses.
        skipped: steps that were left out, in whole or for some Gaussians, because a number was not finite.
        moved_poses: (4, 4) world-to-camera by view key, where poses were corrected. Held-out views are then aligned
            with the finished scene, which is not fitted to them.
    """

    gaussians: Gaussians
    curve: list[dict[str, float | None]]
    seconds: float
    initial: int
    decision: dict[str, Any] = field(default_factory=dict)
    skipped: int = 0
    moved_poses: dict[str, NDArray[np.float64]] = field(default_factory=dict)
