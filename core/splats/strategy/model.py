"""Densification strategies: what they see (`Evidence`), when they act (`Schedule`) and what they return. numpy only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]

SEEN_PIXELS = 0.05
"""Pixels of weight from which a view shows a Gaussian: less is the far tail of a footprint."""
FLOATER_NEARNESS = 0.3
"""A Gaussian nearer to its only viewer than this share of the view's median distance is a blot before the lens."""
FLOATER_VIEWS = 3
"""With fewer views than this, being seen by one says nothing."""


class Strategy(Protocol):
    """How the set of Gaussians changes during training: a value with its constants as fields."""

    @property
    def schedule(self) -> Schedule:
        """When it refines."""

    @property
    def gradient_every(self) -> int:
        """Steps between those whose screen-space gradients are gathered for `Evidence.gradient`; 0 for none."""

    @property
    def perturb_every(self) -> int:
        """Steps between calls of `perturb` during growth; 0 for none, which saves copying the Gaussians."""

    def views_wanted(self, step: int, steps: int, available: int) -> int:
        """How many of `available` training views to render for `Evidence.views` before refining at `step`."""

    def refine(self, gaussians: Gaussians, evidence: Evidence, budget: int, rng: np.random.Generator) -> Refinement:
        """The next set of Gaussians, grown within `budget`.

        Args:
            gaussians: N, in frame units.
        """

    def perturb(self, gaussians: Gaussians, steps: int, means_rate: float, rng: np.random.Generator) -> Gaussians:
        """New values for the same Gaussians, between refinements.

        Args:
            steps: of the run.
            means_rate: current learning rate of the means.
        """


@dataclass(frozen=True)
class Schedule:
    """When a strategy refines, in fractions of the run, so that it suits a run of any length.

    Attributes:
        start, stop: of growth.
        rounds: refinements between them, at least `shortest` steps apart.
    """

    start: float
    stop: float
    rounds: int
    shortest: int = 1

    def every(self, steps: int) -> int:
        """Steps between two rounds."""
        return max(math.ceil((round(self.stop * steps) - round(self.start * steps)) / self.rounds), self.shortest)

    def due(self, step: int, steps: int) -> bool:
        """Whether to refine after `step` of `steps`."""
        first, last = round(self.start * steps), round(self.stop * steps)
        return first <= step <= last and (step - first) % self.every(steps) == 0

    def round_of(self, step: int, steps: int) -> int:
        """The number of the round that is due at `step`, from 0."""
        return (step - round(self.start * steps)) // self.every(steps)

    def growing(self, step: int, steps: int) -> bool:
        """Whether Gaussians may still be added at `step` or later."""
        return step <= self.stop * steps

    def budget(self, step: int, steps: int, initial: int, limit: int) -> int:
        """Most Gaussians after refining at `step`: rises from `initial` to `limit`, fast at first."""
        progress = np.clip((step / steps - self.start) / max(self.stop - self.start, 1e-9), 0.0, 1.0)
        return round(initial + (limit - initial) * float(progress**0.5))


@dataclass(frozen=True)
class Refinement:
    """The new set of Gaussians and where each came from.

    Attributes:
        gaussians: N of them.
        source: (N,) index into the old set, for the optimiser's state.
        fresh: (N,) bool, whether its optimiser state is reset.
    """

    gaussians: Gaussians
    source: NDArray[np.int64]
    fresh: NDArray[np.bool_]


@dataclass(frozen=True)
class Evidence:
    """What the trainer has gathered since the last refinement; None for what the strategy does not use.

    Attributes:
        gradient: (N,) mean screen-space gradient norm (`Gradients.screen_abs`).
        views: from the training views rendered for this refinement.
    """

    gradient: Floats | None = None
    views: ViewEvidence | None = None


@dataclass(frozen=True)
class ViewEvidence:
    """What a number of training views say about N Gaussians.

    Attributes:
        views: how many were rendered.
        complete: whether these are all training views, so that a Gaussian that none of them shows can go.
        seen: (N,) views that show the Gaussian.
        votes: (N,) of these, views that are badly fitted where they show it.
        blame: (N,) sum over the voting views and their pixels of w_jk |I_j - Î_j|: Eq. 8 of Hu and Xiao (2026),
            restricted to views that vote.
        weight: (N,) the largest sum of blend weights w_jk over the pixels of a view: the pixels it covers at best.
        nearness: (N,) distance from the camera of that view, relative to the median of what the view shows.
    """

    views: int
    complete: bool
    seen: Integers
    votes: Integers
    blame: Floats
    weight: Floats
    nearness: Floats

    @property
    def unseen(self) -> NDArray[np.bool_]:
        """(N,) Gaussians that no training view shows: outside every frustum, hidden, or too faint everywhere."""
        return (self.seen == 0) & self.complete

    @property
    def floaters(self) -> NDArray[np.bool_]:
        """(N,) Gaussians that only one of all training views shows, and that hang right before its camera."""
        alone = (self.seen == 1) & (self.nearness < FLOATER_NEARNESS)
        return alone & (self.complete and self.views >= FLOATER_VIEWS)


class ViewEvidenceSum:
    """Accumulates evidence about `count` Gaussians view by view; its memory does not grow with the views."""

    def __init__(self, count: int) -> None:
        self._views = 0
        self._seen = np.zeros(count, np.int32)
        self._votes = np.zeros(count, np.int32)
        self._blame = np.zeros(count, np.float32)
        self._weight = np.zeros(count, np.float32)
        self._nearness = np.full(count, np.inf, np.float32)

    def add(self, weight: Floats, error: Floats, threshold: float, distance: Floats) -> None:
        """Add one view.

        Args:
            weight: (N,) sum of the blend weights over its pixels.
            error: (N,) sum of blend weight times error over its pixels.
            threshold: mean error above which a Gaussian counts as badly fitted.
            distance: (N,) of the Gaussians from its camera.
        """
        self._views += 1
        seen = weight > SEEN_PIXELS
        bad = seen & (error > threshold * weight)
        self._seen += seen
        self._votes += bad
        self._blame += np.where(bad, error, np.float32(0.0))
        best = weight > self._weight
        if seen.any():
            typical = max(float(np.median(distance[seen])), 1e-30)
            self._nearness[best] = distance[best] / typical
        self._weight[best] = weight[best]

    def evidence(self, complete: bool) -> ViewEvidence:
        """The evidence of all views added; see `ViewEvidence.complete`."""
        return ViewEvidence(self._views, complete, self._seen, self._votes, self._blame, self._weight, self._nearness)
