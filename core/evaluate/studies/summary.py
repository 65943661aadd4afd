"""Means of trials over seeds, with their spread, as tables show them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..tables import number
from .recipe import Trial


@dataclass(frozen=True)
class Summary:
    """Of some values.

    Attributes:
        mean: of the finite ones; NaN where there are none.
        deviation: their sample standard deviation; NaN where there are fewer than two.
    """

    mean: float
    deviation: float

    @classmethod
    def of(cls, values: Iterable[float]) -> Summary:
        """Summarise them."""
        finite = [value for value in values if math.isfinite(value)]
        mean = float(np.mean(finite)) if finite else math.nan
        return cls(mean, float(np.std(finite, ddof=1)) if len(finite) > 1 else math.nan)

    def text(self, digits: int) -> str:
        """``0.812 ± 0.003``; without the latter part where there is no spread to tell."""
        mean = number(self.mean, digits)
        return mean if math.isnan(self.deviation) else f"{mean} ± {number(self.deviation, digits)}"


def cell(trials: Sequence[Trial], figure: Callable[[Trial], float], digits: int) -> str:
    """A figure of trials that differ in their seeds alone, as a table shows it."""
    return Summary.of(figure(trial) for trial in trials).text(digits)


def seeds_of(trials: Iterable[Trial], capture: str, label: str) -> list[Trial]:
    """The trials of one row of a table, in the order of their seeds."""
    found = [trial for trial in trials if trial.capture == capture and trial.label == label]
    return sorted(found, key=lambda trial: trial.seed)


def failures(trials: Iterable[Trial]) -> list[str]:
    """A line for every trial that gave no figures."""
    return [
        f"- {trial.capture}, {trial.label}, seed {trial.seed}: {trial.error}" for trial in trials if trial.error != ""
    ]
