"""A rough scene, fitted to small photographs, from which a run starts that is too short for its scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...capture.model import View
from ...runtime.protocol import Reporter, StageSpan
from ..gaussians import Gaussians
from ..targets import Background, block_all, block_mean

if TYPE_CHECKING:
    from .plan import TrainingPlan

_SHORTEST_SIDE = 16  # pixels of a small photograph
Train = Callable[[Sequence[View], "TrainingPlan", Reporter], Gaussians]


@dataclass(frozen=True)
class RoughScene:
    """When a rough scene comes first, how long it is fitted, and to photographs of which size.

    Only the Gaussians in view move in a step, so a run may be too short for its scene: any of a few hundred steps, and
    longer ones of a room that is walked through, where a Gaussian is in one view of seven. Then it begins with steps
    that cost a fraction of its own, since their photographs are small and their Gaussians few.

    Attributes:
        visits: steps of the run in which a Gaussian is in view, on average, below which it is too short.
        side: pixels that the longer side of a small photograph has at least.
        steps: of the rough scene, relative to the run's.
        means_rate: factor of the means' learning rate in the run that starts from it, in which they have settled.
    """

    visits: int = 450
    side: int = 160
    steps: float = 1.67
    means_rate: float = 0.5

    def steps_before(self, steps: int, reach: float) -> int:
        """Steps of the rough scene before a run of `steps`; 0 where there is none.

        Args:
            reach: `means_reach` of the sparse points: views for each one that has a point in its image.
        """
        return round(self.steps * steps) if steps < self.visits * reach else 0


@dataclass(frozen=True)
class RoughFit:
    """The rough scene of one run.

    Attributes:
        plan: of the run.
        means_rate: as in `RoughScene`.
        steps: of the rough scene.
        reduction: factor by which photographs are reduced.
        views: that the run fits.
        background: behind the Gaussians.
        train: fits Gaussians, in world units, to views by a plan.
        reporter: told how far it is, as a part of `stage`.
        stage: of the run.
    """

    plan: TrainingPlan
    means_rate: float
    steps: int
    reduction: int
    views: Sequence[View]
    background: Background
    train: Train
    reporter: Reporter
    stage: str

    @property
    def share(self) -> float:
        """About the share of the time of both fits that this one takes."""
        # Small photographs have fewer pixels, but the work that each Gaussian is stays.
        worth = self.steps / self.reduction**1.5
        return worth / (worth + self.plan.steps)

    def fit(self) -> Gaussians:
        """The Gaussians, in world units."""
        small = [_reduced(view, self.reduction, self.background) for view in self.views]
        pixels = sum(view.camera.width * view.camera.height for view in small)
        message = f"fitting a rough scene to photographs of {max(small[0].image.shape)} pixels"
        self.reporter.status(self.stage, message)
        # What is said of small photographs is not of the run, which finds out for itself.
        span = StageSpan(self.reporter, self.stage, 0.0, self.share, message, warns=False)
        return self.train(small, self._rough_plan(pixels), span)

    def _rough_plan(self, pixels: int) -> TrainingPlan:
        """Exposures are corrected as in the run; whatever is told by pixels of full photographs is left to it."""
        plan = self.plan
        return replace(
            plan,
            steps=self.steps,
            limit=plan.limit and min(plan.limit, plan.growth.ceiling(pixels)),
            sh_degree=0,
            coarse=(),
            poses=None,
            blur=None,
            moving=None,
            contrast=None,
            rough=None,
            curve_points=1,
        )


def rough_fit(
    plan: TrainingPlan,
    reach: float,
    views: Sequence[View],
    background: Background,
    train: Train,
    reporter: Reporter,
    stage: str,
) -> RoughFit | None:
    """The rough scene of a run by `plan`; None where it gets none.

    Args:
        reach: `means_reach` of the sparse points.
        views, background, train, reporter, stage: as in `RoughFit`.
    """
    if plan.rough is None or not views:
        return None
    steps = plan.rough.steps_before(plan.steps, reach)
    sides = [view.image.shape[:2] for view in views]
    reduction = min(max(map(max, sides)) // plan.rough.side, min(map(min, sides)) // _SHORTEST_SIDE)
    if not steps or reduction < 2:  # photographs are small anyway
        return None
    return RoughFit(plan, plan.rough.means_rate, steps, reduction, views, background, train, reporter, stage)


def _reduced(view: View, factor: int, background: Background) -> View:
    """A view with a small photograph over the background; what does not fill a block at the far edges is cut off."""
    camera = view.camera
    height, width = (side // factor for side in view.image.shape[:2])
    lens = {name: getattr(camera, name) / factor for name in ("fx", "fy", "cx", "cy")}
    return replace(
        view,
        camera=replace(camera, width=width, height=height, **lens),
        image=block_mean(background.behind(view), factor),
        alpha=None,
        again=None,
        mask=None if view.mask is None else block_all(view.mask, factor) > 0,
        smear=None if view.smear is None else view.smear / factor,
    )
