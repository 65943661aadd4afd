"""What a strategy is: it looks at evidence and says which Gaussians there shall be from now on. numpy only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..gaussians import Gaussians
from .evidence import Evidence


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
class Schedule:
    """When a strategy acts, in fractions of the run, so that it suits a run of any length.

    Attributes:
        start, stop: between which Gaussians are added.
        rounds: how often, but not more often than every `shortest` steps.
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

    @property
    def disturb_every(self) -> int:
        """Every so many steps, while it grows, `disturb` is called; 0: never, which spares a look at the Gaussians."""

    def views_wanted(self, step: int, steps: int, available: int) -> int:
        """How many of `available` training views to render for `Evidence.views` before refining at `step`."""

    def refine(self, gaussians: Gaussians, evidence: Evidence, budget: int, rng: np.random.Generator) -> Refinement:
        """The next set of Gaussians, grown within `budget`.

        Args:
            gaussians: N, in frame units.
        """

    def disturb(self, gaussians: Gaussians, steps: int, means_rate: float, rng: np.random.Generator) -> Gaussians:
        """Other values for the same Gaussians.

        Args:
            steps: of the run.
            means_rate: the optimiser's present step size of the positions.
        """
