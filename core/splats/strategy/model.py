"""What a strategy is: it looks at evidence and says which Gaussians there shall be from now on. numpy only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Refinement:
    """The new set of Gaussians and where each came from.

    Attributes:
        gaussians: N of them.
        source: (N,) index into the old set, for the optimiser's state.
        fresh: (N,) bool, whether the optimiser starts anew.
    """

    gaussians: Gaussians
    source: NDArray[np.int64]
    fresh: NDArray[np.bool_]


@dataclass(frozen=True)
class ViewEvidence:
    """What V training views say about N Gaussians.

    Attributes:
        weight: (V, N), sum over the view's pixels of the blend weight w_jk: as many pixels show the Gaussian.
        error: (V, N), sum over the pixels of w_jk |I_j - Î_j|, the view's share of the seed's Eq. 8.
        threshold: (V,) the mean error above which the view calls a Gaussian badly fitted.
        complete: whether these are all training views, so that what none of them shows is not needed.
    """

    weight: Floats
    error: Floats
    threshold: Floats
    complete: bool

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(V, N) whether the view shows the Gaussian at all."""
        return self.weight > SEEN

    @property
    def blamed(self) -> NDArray[np.bool_]:
        """(V, N) whether the view shows the Gaussian and its weighted mean error is above the threshold."""
        return self.seen & (self.error > self.threshold[:, None] * self.weight)


SEEN = 0.05
"""Pixels of weight from which a view shows a Gaussian: less is the far tail of a footprint."""


@dataclass(frozen=True)
class Evidence:
    """What the trainer has gathered since the last refinement; None is what the strategy did not ask for.

    Attributes:
        gradient: (N,) mean screen-space gradient norm (`Gradients.screen_abs`).
        views: of the training views rendered for this refinement.
    """

    gradient: Floats | None = None
    views: ViewEvidence | None = None


@dataclass(frozen=True)
class Schedule:
    """When a strategy acts, in fractions of the run, so that it suits a run of any length.

    Attributes:
        start, stop: between which Gaussians are added.
        rounds: how often.
    """

    start: float
    stop: float
    rounds: int

    def due(self, step: int, steps: int) -> bool:
        """Whether to refine after `step` of `steps`."""
        first, last = round(self.start * steps), round(self.stop * steps)
        every = max(math.ceil((last - first) / self.rounds), 1)
        return first <= step <= last and (step - first) % every == 0

    def growing(self, step: int, steps: int) -> bool:
        """Whether Gaussians may still be added after `step`."""
        return step <= self.stop * steps

    def budget(self, step: int, steps: int, initial: int, limit: int) -> int:
        """How many Gaussians there may be after refining at `step`: from `initial` to `limit`, fast at first."""
        progress = np.clip((step / steps - self.start) / max(self.stop - self.start, 1e-9), 0.0, 1.0)
        return round(initial + (limit - initial) * float(progress**0.5))


class Strategy(Protocol):
    """How the set of Gaussians changes during training: a value whose constants are its fields."""

    @property
    def schedule(self) -> Schedule:
        """When it acts."""

    @property
    def gradient_every(self) -> int:
        """Every so many steps the screen-space gradients are gathered; 0: it does not need them."""

    def views_wanted(self, step: int, steps: int, available: int) -> int:
        """How many of `available` training views to render for `Evidence.views` before refining at `step`."""

    def refine(self, gaussians: Gaussians, evidence: Evidence, budget: int, rng: np.random.Generator) -> Refinement:
        """The next set of Gaussians, within `budget`.

        Args:
            gaussians: N, in frame units.
        """

    def disturb(
        self, gaussians: Gaussians, step: int, means_rate: float, rng: np.random.Generator
    ) -> Gaussians | None:
        """What the strategy does to the Gaussians between refinements; None where it leaves them alone at `step`."""
