"""Growth where several views agree that the fit is bad, and no Gaussian that no view needs. numpy only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians
from .editing import concatenate, divide, finite
from .evidence import Evidence, ViewEvidence
from .model import Refinement, Schedule
from .pruning import floaters, unseen


@dataclass(frozen=True)
class MultiViewConsistent:
    """Multi-view consistent densification and pruning.

    The idea is FastGS's: an error that one view has may be noise, exposure or a reflection, and a Gaussian put there
    overfits it; an error that several views have at one Gaussian is missing detail. Different from there, what counts
    as an error is a rank among the view's own pixels with an absolute floor, so that one pixel cannot rule and a
    perfect view asks for nothing; two views are enough; everything is in fractions of the run.

    Attributes:
        schedule: when; a round costs as much as a dozen steps.
        sample: training views asked in a round; in large captures `sample_share` of them.
        census_every: every so many rounds all views are asked, and what none of them needs is removed.
        agreeing: so many views have to complain about a Gaussian before it is divided; all, where there are fewer.
        growth: Gaussians divided in a round, at most, relative to those there are; those with the largest e_k first.
        needed_pixels: a Gaussian that in no view is worth so many pixels is removed.
        min_opacity: and so is one below this.
        prune: whether any is removed before the end of the run.
        gradient_every: 0, they are not needed, which saves a third of the backward pass.
        disturb_every: 0.
    """

    schedule: Schedule = field(default_factory=lambda: Schedule(0.06, 0.6, rounds=12, shortest=60))
    sample: int = 10
    sample_share: float = 0.125
    census_every: int = 4
    agreeing: int = 2
    growth: float = 0.3
    needed_pixels: float = 2.0
    min_opacity: float = 0.005
    prune: bool = True
    gradient_every: int = 0
    disturb_every: int = 0

    def views_wanted(self, step: int, steps: int, available: int) -> int:
        """A sample, and all at a census alone."""
        if self.prune and self.schedule.round_of(step, steps) % self.census_every == self.census_every - 1:
            return available
        # Never all, or every round would be a census where there are few views, and leave next to nothing of the scene.
        return min(max(self.sample, round(self.sample_share * available)), max(available - 1, 1))

    def refine(self, gaussians: Gaussians, evidence: Evidence, budget: int, rng: np.random.Generator) -> Refinement:
        """Remove what no view needs, then divide what the views agree on, within `budget`."""
        views = evidence.views
        if views is None:
            raise ValueError("multi-view consistency needs the views")
        kept = self._needed(gaussians, views)
        divided = self._chosen(kept, views, budget)
        stay = kept.copy()
        stay[divided] = False
        stays = np.flatnonzero(stay)
        source = np.concatenate([stays, divided, divided])
        halves = divide(gaussians.take(divided))
        return Refinement(concatenate(gaussians.take(stays), *halves), source, np.arange(len(source)) >= len(stays))

    def disturb(self, gaussians: Gaussians, steps: int, means_rate: float, rng: np.random.Generator) -> Gaussians:
        """The Gaussians as they are: between refinements they are left alone."""
        return gaussians

    def _needed(self, gaussians: Gaussians, views: ViewEvidence) -> NDArray[np.bool_]:
        if not self.prune:
            return finite(gaussians)
        with np.errstate(invalid="ignore"):
            kept = finite(gaussians) & (gaussians.opacities >= self.min_opacity)
        if views.complete:
            needed = kept & (views.weight >= self.needed_pixels) & ~unseen(views) & ~floaters(views)
            # Nothing is needed where nothing fits: a start that far off is left to the optimiser.
            return needed if needed.any() else kept
        return kept

    def _chosen(self, kept: NDArray[np.bool_], views: ViewEvidence, budget: int) -> NDArray[np.int64]:
        candidates = np.flatnonzero(kept & (views.votes >= min(self.agreeing, views.views)))
        count = int(kept.sum())
        room = max(min(budget - count, round(self.growth * count)), 0)
        worst_first = np.argsort(-views.blame[candidates], kind="stable")
        return np.sort(candidates[worst_first[:room]])
