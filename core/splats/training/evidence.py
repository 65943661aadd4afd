"""Gathers what training views say about every Gaussian: how much of it they show, and with how much error.

What masks leave out is not looked at: it shows no Gaussian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from ..calibration.corrections import ViewCorrections
from ..calibration.motion_blur import smeared_array
from ..gaussians import SH_C0
from ..raster import ParameterSet, Rasterizer
from ..strategy import Strategy, ViewEvidence, ViewEvidenceSum
from ..targets import Background, TrainingView
from .schedule import TrainingSchedule

ERROR_PERCENTILE = 70.0
"""Of a view's own pixel errors: a rank, so that neither a single pixel nor the scene's noise level dominates."""
ERROR_FLOOR = 0.02
"""Mean absolute difference of sRGB values (5 of 255) that counts as well fitted, whatever the percentile."""

_DARKEST = np.float32((1.0 / 512.0 - 0.5) / SH_C0)  # degree-0 coefficient of a colour just above black


def gather_view_evidence(
    rasterizer: Rasterizer,
    parameters: ParameterSet,
    views: Sequence[TrainingView],
    background: Background,
    *,
    complete: bool,
    reduction: int = 1,
) -> ViewEvidence:
    """Render every view, and sum blend weights and weighted errors per Gaussian in one backward pass.

    dL/d(colour of k) is the sum over the pixels of w_jk dL/d(pixel j). So with a "dL/d(pixel)" of 1 in one channel and
    of the error in another, one backward pass gives both sums.

    Args:
        complete: whether `views` are all training views.
        reduction: factor by which the views are reduced. Sums are in pixels of the full images.
    """
    shown, weighed = _without_black(parameters)
    means = parameters.means.numpy()
    total = ViewEvidenceSum(len(parameters))
    for view in views:
        image, camera = view.at(reduction)
        frame = rasterizer.render(shown, camera, background.color)
        color = smeared_array(frame.color.numpy(), view.smear_at(reduction))
        error = np.nan_to_num(np.abs(color - image.numpy() * np.float32(1.0 / 255.0)).mean(axis=2))
        mask = view.mask_at(reduction)
        looked_at = np.ones(error.shape, bool) if mask is None else mask.pixels.numpy() > 0
        error *= looked_at
        threshold = max(
            float(np.percentile(error[looked_at], ERROR_PERCENTILE)) if looked_at.any() else 0.0, ERROR_FLOOR
        )
        grad_color = wp.array(
            np.stack([looked_at.astype(error.dtype), error, np.zeros_like(error)], axis=2),
            dtype=wp.float32,
            device=rasterizer.device,
        )
        if weighed is not shown:
            frame = rasterizer.render(weighed, camera, background.color)
        sums = rasterizer.backward(frame, grad_color=grad_color, colors_only=True).sh.numpy()[:, 0]
        full_image, _ = view.at(1)
        pixels = np.float32(full_image.size / image.size / SH_C0)
        distance = np.linalg.norm(means - camera.center.astype(np.float32), axis=1)
        total.add(sums[:, 0] * pixels, sums[:, 1] * pixels, threshold, distance)
    return total.evidence(complete)


class EvidenceSource:
    """Gathers evidence in the rounds of densification of one run.

    The views that are fitted come first among its views, and grow in number when validation ends.

    Args:
        rasterizer: renders the views.
        background: behind the Gaussians.
        corrections: of the views.
        strategy: says how many views a round wants.
        schedule: says at which resolution.
        steps: planned length of the run.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        background: Background,
        corrections: ViewCorrections,
        strategy: Strategy,
        schedule: TrainingSchedule,
        steps: int,
    ) -> None:
        self._rasterizer, self._background, self._corrections = rasterizer, background, corrections
        self._strategy, self._schedule, self._steps = strategy, schedule, steps

    def is_census(self, step: int, fitted: int) -> bool:
        """Whether the round at `step` asks all of the `fitted` views, so that what none needs can go."""
        return self._strategy.views_wanted(step, self._steps, fitted) == fitted

    def sampled(
        self, step: int, fitted: int, parameters: ParameterSet, rng: np.random.Generator
    ) -> ViewEvidence | None:
        """What the views of the round at `step` say; None if it wants none."""
        wanted = self._strategy.views_wanted(step, self._steps, fitted)
        if not wanted:
            return None
        chosen = np.sort(rng.choice(fitted, wanted, replace=False)).tolist()
        reduction = self._schedule.coarsest if wanted == fitted else self._schedule.reduction(step)
        return self._evidence(chosen, fitted, parameters, reduction)

    def all(self, fitted: int, parameters: ParameterSet) -> ViewEvidence:
        """What all `fitted` views say: what to remove. Fine detail does not change that: low resolution is enough."""
        return self._evidence(range(fitted), fitted, parameters, self._schedule.coarsest)

    def _evidence(self, views: Sequence[int], fitted: int, parameters: ParameterSet, reduction: int) -> ViewEvidence:
        return gather_view_evidence(
            *(self._rasterizer, parameters, self._corrections.seen(views, reduction), self._background),
            complete=len(views) == fitted,
            reduction=reduction,
        )


def _without_black(parameters: ParameterSet) -> tuple[ParameterSet, ParameterSet]:
    """The Gaussians to compare with the photographs and those to sum weights on; the same if possible.

    The gradient of a channel vanishes where the colour is clipped at black, and its weight with it. Colours of degree 0
    are lifted from black by less than a byte's step; with view-dependent colours, weights are summed in grey.
    """
    sh = parameters.sh.numpy()
    if parameters.sh_count > 1:
        grey = wp.zeros(parameters.sh.shape, dtype=wp.float32, device=parameters.device)
        return parameters, replace(parameters, sh=grey)
    lifted = wp.array(np.maximum(sh, _DARKEST), dtype=wp.float32, device=parameters.device)
    shown = replace(parameters, sh=lifted)
    return shown, shown
