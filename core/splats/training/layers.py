"""Colour layers: the colours of a finished geometry, fitted to the enhanced views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from ...capture.model import View
from ...color.noise import typical_noise
from ..gaussians import Gaussians
from ..raster import ContrastPlan, LearningRates, Rasterizer
from ..targets import Background
from .fitting import fit_guided
from .losses import GuidedLoss, KeptContrast, SeenContrast, ViewGuide


@dataclass(frozen=True)
class LayerPlan:
    """How a colour layer is fitted.

    With the geometry frozen the image is linear in the degree-0 colours, so this is a convex problem; with an absolute
    error, the colour that most views agree on wins over one that a few have drifted to.

    Attributes:
        epochs: passes over the views.
        minimum_steps: for captures of few views.
        learning_rate: of the degree-0 coefficients, initially.
        lr_final_factor: factor of the learning rate at the end, reached exponentially.
        ssim_weight: weight of 1 - SSIM in the loss; higher than for the geometry, since layers are about contrast.
        multi_view_weight: λ_mv of the multi-view loss, for guides with a consensus.
        contrast: the hinge that keeps the contrast of the enhanced views for the layer's observer; with a weight of 0
            noise counts as detail.
    """

    epochs: int = 3
    minimum_steps: int = 300
    learning_rate: float = 5e-2
    lr_final_factor: float = 0.05
    ssim_weight: float = 0.5
    multi_view_weight: float = 2.0
    contrast: ContrastPlan = field(default_factory=ContrastPlan)

    @classmethod
    def of_photographs(cls) -> LayerPlan:
        """For the photographs' own colours, to begin with those that the geometry was trained with."""
        return cls(epochs=1, minimum_steps=150, learning_rate=2e-2, contrast=ContrastPlan(weight=3.0))


def fit_layer(
    rasterizer: Rasterizer,
    gaussians: Gaussians,
    views: Sequence[View],
    plan: LayerPlan,
    background: Background,
    seed: int,
    progress: Callable[[float], None] = lambda _: None,
    guides: Sequence[ViewGuide] | None = None,
    contrast: SeenContrast | None = None,
) -> Gaussians:
    """`gaussians` with colours of SH degree 0 that reproduce `views`.

    Args:
        gaussians: the finished geometry, in world units.
        views: training views with their enhanced images.
        progress: receives the fraction done.
        guides: one per view; None weighs every pixel equally, without a multi-view loss.
        contrast: to keep, of the same views; None leaves it to the photometric loss.
    """
    kept = KeptContrast.of(rasterizer, contrast, background) if contrast else None
    noise = typical_noise([view.image for view in views]) if plan.contrast.weight else 0.0
    loss = GuidedLoss(rasterizer, guides, plan.ssim_weight, plan.multi_view_weight, kept, noise)
    fitted, _ = fit_guided(
        rasterizer,
        gaussians.with_base_colors(gaussians.base_colors),
        views,
        background,
        loss,
        lambda done: LearningRates(sh0=plan.learning_rate * plan.lr_final_factor**done),
        max(plan.epochs * len(views), plan.minimum_steps),
        seed,
        progress,
        colors_only=True,
    )
    return gaussians.with_base_colors(fitted.base_colors)
