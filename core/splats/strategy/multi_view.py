"""Growth where several views agree that the fit is bad, and no Gaussian that no view needs. numpy only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians
from .editing import concatenate, divide, finite, take
from .model import Evidence, Refinement, Schedule, ViewEvidence


@dataclass(frozen=True)
class MultiViewConsistent:
    schedule: Schedule = Schedule(0.06, 0.6, 12)
    gradient_every: int = 0
    sample: int = 10
    census_every: float = 0.18
    agreeing_views: int = 2
    agreeing_share: float = 0.0
    min_opacity: float = 0.005
    min_weight: float = 0.5
    growth: float = 0.3

    def views_wanted(self, step, steps, available):
        first = round(self.schedule.start * steps)
        every = max(round((self.schedule.stop - self.schedule.start) * steps / self.schedule.rounds), 1)
        rnd = (step - first) // every
        return available if rnd % 4 == 3 else min(self.sample, available)

    def refine(self, gaussians, evidence, budget, rng):
        views = evidence.views
        opacity = gaussians.opacities
        with np.errstate(invalid="ignore"):
            kept = finite(gaussians) & (opacity >= self.min_opacity)
        if views.complete:
            kept &= (views.weight.max(axis=0) >= self.min_weight)
        blamed = views.blamed
        votes = blamed.sum(axis=0)
        need = np.maximum(min(self.agreeing_views, len(views.weight)), self.agreeing_share * views.seen.sum(axis=0))
        score = np.where(blamed, views.error, 0.0).sum(axis=0)
        cand = np.flatnonzero(kept & (votes >= need))
        room = max(min(budget - int(kept.sum()), int(self.growth * kept.sum())), 0)
        if len(cand) > room:
            cand = np.sort(cand[np.argsort(-score[cand], kind="stable")[:room]])
        stay = kept.copy()
        stay[cand] = False
        stay_index = np.flatnonzero(stay)
        source = np.concatenate([stay_index, cand, cand])
        fresh = np.arange(len(source)) >= len(stay_index)
        a, b = divide(take(gaussians, cand))
        return Refinement(concatenate(take(gaussians, stay_index), a, b), source, fresh)

    def disturb(self, gaussians, step, means_rate, rng):
        return None
