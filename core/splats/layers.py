"""Colour layers: the colours of a finished geometry, fitted to the enhanced views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..capture.model import View
from .fitting import Fit
from .gaussians import Gaussians
from .guides import GuidedLoss, ViewGuide
from .raster import LearningRates, Rasterizer
from .scene_frame import SceneFrame
from .targets import Background, ViewOrder, prepare_targets


@dataclass(frozen=True)
class LayerPlan:
    """How a colour layer is fitted.

    With the geometry frozen the image is linear in the degree-0 colours, so this is a convex problem; the absolute
    error makes the colour that most views agree on win over the one that a few drifted to.

    Attributes:
        epochs: passes over the views.
        minimum_steps: for captures of few views.
        rate: step size of the degree-0 coefficients at the start; `rate_decay` of it is left at the end.
        ssim_weight: share of 1 - SSIM in the loss; more than for the geometry, since contrast is what a layer is for.
        multi_view_weight: λ_mv of the multi-view loss where a consensus of the views is given.
    """

    epochs: int = 3
    minimum_steps: int = 300
    rate: float = 5e-2
    rate_decay: float = 0.05
    ssim_weight: float = 0.5
    multi_view_weight: float = 1.0


def fit_layer(
    rasterizer: Rasterizer,
    gaussians: Gaussians,
    views: Sequence[View],
    plan: LayerPlan,
    background: Background,
    seed: int,
    progress: Callable[[float], None] = lambda _: None,
    guides: Sequence[ViewGuide] | None = None,
) -> Gaussians:
    """`gaussians` with colours of SH degree 0 that reproduce `views`.

    Args:
        gaussians: the finished geometry, in world units.
        views: training views whose images are the enhanced ones.
        progress: receives the fraction done.
        guides: one for each view; None counts every pixel alike, without a multi-view loss.
    """
    frame = SceneFrame.around(views, gaussians.means)
    local = frame.from_world(gaussians.with_base_colors(gaussians.base_colors))
    fit = Fit(rasterizer, local, background, plan.ssim_weight)
    targets = prepare_targets(rasterizer, views, frame, background, set())
    loss = GuidedLoss(rasterizer, guides, plan.ssim_weight, plan.multi_view_weight)
    order = ViewOrder(len(targets), np.random.default_rng(seed))
    steps = max(plan.epochs * len(targets), plan.minimum_steps)
    for step in range(1, steps + 1):
        view = order.next()
        rates = LearningRates(sh0=plan.rate * plan.rate_decay ** (step / steps))
        fit.step(targets[view], 1, rates, colors_only=True, loss=loss.of(view))
        progress(step / steps)
    return gaussians.with_base_colors(fit.parameters.to_gaussians().base_colors)
