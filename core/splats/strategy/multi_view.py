"""Densification where several views agree that the fit is bad, and pruning of what no view needs. numpy only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians
from .editing import concatenate, divide, finite
from .model import Evidence, Refinement, Schedule, ViewEvidence


@dataclass(frozen=True)
class MultiViewConsistent:
    """Multi-view consistent densification and pruning.

    The idea is FastGS's: an error in a single view may be noise, exposure or a reflection, and a Gaussian added there
    overfits it; an error that several views have at one Gaussian is missing detail. Unlike FastGS, an error is defined
    by its rank among the view's own pixels with an absolute floor, so that no single pixel dominates and a perfect view
    asks for nothing; two views are enough; everything is in fractions of the run.

    Attributes:
        schedule: when to refine; a round costs as much as a dozen steps.
        sample: training views rendered in a round; in large captures `sample_share` of them.
        census_every: rounds between those that render all views and remove what none of them needs.
        agreeing: views that have to vote for a Gaussian before it is divided; all, if there are fewer.
        growth: largest share of the Gaussians divided in a round; those with the most blame first.
        needed_pixels: a Gaussian that covers fewer pixels in every view is removed,
        needed_share: if that is also less than this share of what one of them covers on average: where photographs are
            small or Gaussians many, few of them cover many pixels.
        min_opacity: a Gaussian below it is removed.
        prune: whether Gaussians are removed before the end of the run.
        gradient_every: 0: gradients are not needed, which saves a third of the backward pass.
        perturb_every: 0.
    """

    schedule: Schedule = field(default_factory=lambda: Schedule(0.06, 0.6, rounds=12, shortest=60))
    sample: int = 10
    sample_share: float = 0.125
    census_every: int = 4
    agreeing: int = 2
    growth: float = 0.3
    needed_pixels: float = 2.0
    needed_share: float = 0.3
    min_opacity: float = 0.005
    prune: bool = True
    gradient_every: int = 0
    perturb_every: int = 0

    def views_wanted(self, step: int, steps: int, available: int) -> int:
        """A sample, or all views in a census."""
        if self.prune and self.schedule.round_of(step, steps) % self.census_every == self.census_every - 1:
            return available
        # Never all: with few views every round would be a census, and leave next to nothing of the scene.
        return min(max(self.sample, round(self.sample_share * available)), max(available - 1, 1))

    def refine(self, gaussians: Gaussians, evidence: Evidence, budget: int, rng: np.random.Generator) -> Refinement:
        """Remove what no view needs, then divide what several views vote for, within `budget`."""
        views = evidence.views
        if views is None:
            raise ValueError("multi-view consistency needs views")
        kept = self._needed(gaussians, views)
        divided = self._chosen(kept, views, budget)
        stay = kept.copy()
        stay[divided] = False
        stays = np.flatnonzero(stay)
        source = np.concatenate([stays, divided, divided])
        halves = divide(gaussians.take(divided))
        return Refinement(concatenate(gaussians.take(stays), *halves), source, np.arange(len(source)) >= len(stays))

    def perturb(self, gaussians: Gaussians, steps: int, means_rate: float, rng: np.random.Generator) -> Gaussians:
        """The Gaussians unchanged."""
        return gaussians

    def _needed(self, gaussians: Gaussians, views: ViewEvidence) -> NDArray[np.bool_]:
        if not self.prune:
            return finite(gaussians)
        with np.errstate(invalid="ignore"):
            kept = finite(gaussians) & (gaussians.opacities >= self.min_opacity)
        if views.complete:
            average = float(views.weight[kept].mean()) if kept.any() else 0.0
            least = min(self.needed_pixels, self.needed_share * average)
            needed = kept & (views.weight >= least) & ~views.unseen & ~views.floaters
            # If nothing is needed, nothing fits: a start that far off is left to the optimiser.
            return needed if needed.any() else kept
        return kept

    def _chosen(self, kept: NDArray[np.bool_], views: ViewEvidence, budget: int) -> NDArray[np.int64]:
        candidates = np.flatnonzero(kept & (views.votes >= min(self.agreeing, views.views)))
        count = int(kept.sum())
        room = max(min(budget - count, round(self.growth * count)), 0)
        worst_first = np.argsort(-views.blame[candidates], kind="stable")
        return np.sort(candidates[worst_first[:room]])
