"""Which Gaussians a run starts from, and how far these have to be able to move."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...capture.model import View
from ..gaussians import Gaussians
from ..raster import LearningRates, RasterCamera, Rasterizer
from ..scene_frame import SceneFrame
from ..targets import Background, TrainingView, ViewOrder
from .decisions import GrowthRule
from .fitting import Fit
from .initialise import DenseStart, InitialGaussians
from .rough import RoughFit

_SAMPLED = 2000  # Gaussians by which the visible share is told
_LARGEST_REACH = 16.0  # with more, means no longer settle


@dataclass(frozen=True)
class StartRule:
    """Chooses between a start from sparse points and one with dense stereo, by short trials of both.

    Attributes:
        dense: how dense stereo adds points; None to start from sparse points without asking.
        steps: of a trial, as a share of the run's, at the lowest resolution; within `fewest_steps`, since small
            Gaussians first have to become opaque, and `most_steps`.
        largest_share: of the run's steps; if a trial would take more, none is made, and sparse points are taken. The
            steps of the start that is chosen are not lost, so this is what the other one may cost.
        doubling_gain: dB on validation views that each doubling of the Gaussians at the start has to gain, as in
            `GrowthRule`: what a run starts with, it mostly keeps.
        few_gain: dB that less than a doubling has to gain. Points of dense stereo beside more sparse ones raise PSNR
            even where they draw plain walls nearer, which it does not show; where they fill gaps, they gain more.
    """

    dense: DenseStart | None = field(default_factory=DenseStart)
    steps: float = 0.05
    fewest_steps: int = 100
    most_steps: int = 200
    largest_share: float = 0.5
    doubling_gain: float = GrowthRule.doubling_gain
    few_gain: float = 0.8

    def least_gain(self, dense: int, sparse: int) -> float:
        """dB that a start of `dense` Gaussians has to gain over one of `sparse`."""
        doublings = math.log2(dense / max(sparse, 1))
        return self.doubling_gain * doublings if doublings >= 1.0 else self.few_gain

    def trial_steps(self, steps: int) -> int:
        """Steps of a trial in a run of `steps`; 0 if the run is too short for one."""
        trial = min(max(round(self.steps * steps), self.fewest_steps), self.most_steps)
        return trial if trial <= self.largest_share * steps else 0


@dataclass(frozen=True)
class StartChoice:
    """What a run starts from.

    Attributes:
        gaussians: in the frame.
        words: for the report; empty if there was nothing to choose.
        means_rate: factor of the means' learning rate: less than 1 where they are near where they will stay.
    """

    gaussians: Gaussians
    words: str = ""
    means_rate: float = 1.0


@dataclass(frozen=True)
class StartTrial:
    """What a trial needs.

    Attributes:
        rasterizer: renders the views.
        background: behind the Gaussians.
        fitted: views to fit.
        validation: views that judge; without any, there is no trial.
        reduction: factor by which views are reduced while they are fitted.
        steps: of each trial.
        ssim_weight: of the loss.
        learning_rates: the initial ones.
        seed: of the order of the views.
        noise: standard deviation of the photographs' noise, in [0, 1].
        told: receives what is being done, in words.
        goes_on: whether the run goes on from where the trial left what is chosen, and does not begin anew. Of few
            views, which are soon overfitted, these steps may do harm.
    """

    rasterizer: Rasterizer
    background: Background
    fitted: Sequence[TrainingView]
    validation: Sequence[TrainingView]
    reduction: int
    steps: int
    ssim_weight: float
    learning_rates: LearningRates
    seed: int
    noise: float = 0.0
    told: Callable[[str], None] = lambda _message: None
    goes_on: bool = True

    @property
    def possible(self) -> bool:
        """Whether there is anything to judge by, and time for it."""
        return bool(self.validation) and self.steps > 0

    def fitted_from(self, start: Gaussians) -> tuple[Gaussians, float]:
        """What a run from `start` begins with, and the PSNR after a trial on the views that judge, in dB."""
        cameras = [view.at(1)[1] for view in self.fitted]
        rates = replace(self.learning_rates, means=self.learning_rates.means * means_reach(start.means, cameras))
        fit = Fit(self.rasterizer, start, self.background, self.ssim_weight, self.noise)
        order = ViewOrder(len(self.fitted), np.random.default_rng(self.seed))
        for _ in range(self.steps):
            fit.step(self.fitted[order.next()], self.reduction, rates)
        return fit.parameters.to_gaussians() if self.goes_on else start, fit.psnr(self.validation)


def choose_start(
    initial: InitialGaussians,
    rule: StartRule,
    trial: StartTrial,
    views: Sequence[View],
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
    frame: SceneFrame,
    limit: int,
    rough: RoughFit | None = None,
) -> StartChoice:
    """The Gaussians of SH degree 0 with which validation views are matched better after a short trial.

    They are returned as they are after their trial, so that its steps are not lost, unless the run begins anew.

    Args:
        rough: the run's rough scene, which is tried if there is one.
        views: those that are fitted.
        points, colors: (P, 3) sparse points in world units and their (P, 3) uint8 sRGB colours.
        limit: largest number of Gaussians.
    """

    def made(dense: DenseStart | None) -> Gaussians:
        rng = np.random.default_rng(trial.seed)
        return replace(initial, dense=dense).make(views, points, colors, frame, rng, limit)

    sparse = made(None)

    @cache
    def fitted_sparse() -> tuple[Gaussians, float]:
        return trial.fitted_from(sparse)

    if not trial.possible:
        return StartChoice(sparse)
    otherwise = StartChoice(sparse)
    if rough is not None:
        settled = frame.from_world(rough.fit())
        trial.told(f"trying a start from the rough scene, and from {len(sparse):,} points")
        settled, psnr = trial.fitted_from(settled)
        gain = psnr - fitted_sparse()[1]
        if gain > 0.0:
            return StartChoice(settled, f"a rough scene, which gained {gain:.2f} dB in a trial", rough.means_rate)
        otherwise = StartChoice(fitted_sparse()[0])
    if rule.dense is None:
        return otherwise
    trial.told(f"comparing {len(views)} photographs with each other for more points")
    dense = made(rule.dense)
    if np.array_equal(dense.means, sparse.means):  # nothing was found
        return otherwise
    trial.told(f"trying a start from {len(dense):,} points, and from {len(sparse):,}")
    count = len(dense)
    dense, psnr = trial.fitted_from(dense)
    fitted, psnr_of_sparse = fitted_sparse()
    gain = psnr - psnr_of_sparse
    if gain < rule.least_gain(count, len(sparse)):
        return StartChoice(
            fitted, f"sparse points: dense stereo gained {gain:.2f} dB in a trial, too little for its number"
        )
    return StartChoice(dense, f"dense stereo, which gained {gain:.2f} dB in a trial")


def means_reach(means: NDArray[np.float32], cameras: Sequence[RasterCamera]) -> float:
    """The factor of the means' learning rate that makes up for steps in which a Gaussian is out of view; at least 1.

    Only the Gaussians in view move in a step. Where cameras go round an object, that is nearly all of them; in a room
    that is walked through, one in seven. So that they get as far in as many steps, the rate is divided by the share of
    views that have a Gaussian in their image, on average.

    Args:
        means: (N, 3) in the frame of the cameras.
    """
    if not len(means) or not cameras:
        return 1.0
    sample = means[:: max(len(means) // _SAMPLED, 1)].astype(np.float64)
    seen = 0
    for camera in cameras:
        pose = camera.world_to_camera
        local = sample @ pose[:3, :3].T + pose[:3, 3]
        depth = np.where(local[:, 2] > 1e-6, local[:, 2], np.inf)
        x, y = local[:, 0] / depth * camera.fx + camera.cx, local[:, 1] / depth * camera.fy + camera.cy
        inside = (local[:, 2] > 1e-6) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
        seen += int(inside.sum())
    return float(np.clip(len(cameras) * len(sample) / max(seen, 1), 1.0, _LARGEST_REACH))
