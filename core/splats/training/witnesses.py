"""Which training views say, in a round of densification, what each Gaussian is worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calibration.corrections import ViewCorrections
from ..raster import ParameterSet, Rasterizer
from ..strategy import Strategy, ViewEvidence
from ..targets import Background
from .evidence import gather_view_evidence
from .schedule import TrainingSchedule


class Witnesses:
    """Asks the views of one run; those that are fitted come first, and grow in number when validation ends.

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
