"""Short fits of small scenes before a run: how well views that are held back like the cameras of the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...capture.model import View
from ..gaussians import Gaussians
from ..raster import Rasterizer
from ..scene_frame import SceneFrame
from ..targets import Background, TrainingView, ViewOrder, prepare_targets
from .fitting import Fit
from .initialise import InitialGaussians
from .plan import TrainingPlan

Posed = tuple[Sequence[View], NDArray[np.float32], NDArray[np.uint8]]
"""Views, and (P, 3) sparse points in world units with their (P, 3) uint8 sRGB colours; P may be 0."""

_TOLD_EVERY = 10  # steps


@dataclass(frozen=True)
class ShortFit:
    """How small a scene is, and how it is fitted.

    Attributes:
        rasterizer: renders the views.
        background: behind the Gaussians.
        steps: of the fit.
        gaussians: largest number of them; they are neither densified nor pruned.
        side: longer side of the views in pixels, about.
        ssim_weight: of the loss.
        initial: how the Gaussians are initialised.
    """

    rasterizer: Rasterizer
    background: Background
    steps: int
    gaussians: int
    side: int
    ssim_weight: float
    initial: InitialGaussians

    def prepare(
        self,
        views: Sequence[View],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
        rng: np.random.Generator,
    ) -> tuple[list[TrainingView], Gaussians]:
        """The views, reduced, and Gaussians to start from, in one frame.

        Args:
            points, colors: (P, 3) sparse points in world units and their uint8 sRGB colours; P may be 0.
        """
        frame = SceneFrame.around(views, points)
        longest = max(side for view in views for side in (view.camera.width, view.camera.height))
        reduction = max(round(longest / self.side), 1)
        prepared = prepare_targets(self.rasterizer, views, frame, self.background, {reduction})
        gaussians = self.initial.make(views, points, colors, frame, rng, self.gaussians)
        return [view.reduced(reduction) for view in prepared], gaussians

    def gain(self, before: Posed, after: Posed, every: int, seed: int, told: Callable[[float], None]) -> float:
        """dB that every so many-th view gains by other cameras, each seen from its own in a scene fitted to the rest.

        Args:
            told: called with the fraction that is done.
        """
        first = self._judged(before, every, seed, lambda done: told(done / 2.0))
        return self._judged(after, every, seed, lambda done: told((1.0 + done) / 2.0)) - first

    def _judged(self, posed: Posed, every: int, seed: int, told: Callable[[float], None]) -> float:
        targets, gaussians = self.prepare(*posed, np.random.default_rng(seed))
        judging, fitted = targets[::every], [target for i, target in enumerate(targets) if i % every]
        fit, training = Fit(self.rasterizer, gaussians, self.background, self.ssim_weight), TrainingPlan()
        order = ViewOrder(len(fitted), np.random.default_rng(seed))
        for step in range(self.steps):
            fit.step(fitted[order.next()], 1, training.learning_rates_at(step / self.steps))
            if step % _TOLD_EVERY == 0:
                told(step / self.steps)
        return fit.psnr(judging)
