"""Decides by views that are not fitted how many Gaussians, steps and SH degrees a scene needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .raster import LearningRates

MANY_VIEWS = 24
"""Training views from which some can be kept aside for decisions."""
FEW_VIEWS = 8
"""Training views from which one can be kept aside where nothing else is held out."""
_MOST_DECIDING = 6
_ONE_IN = 18  # on the demo two of 35 views kept aside to the end cost 0.3 dB
_LEAST_DOUBLINGS = 0.1  # of the number of Gaussians, for a gain to be ascribed to it


class Measurement(NamedTuple):
    """PSNR (dB) of the deciding views after a step, with so many Gaussians.

    `work` counts the intersections of Gaussians with tiles so far. Time goes with it, and unlike time it is the same
    whenever a run is repeated, so that the same seed gives the same decisions.
    """

    step: int
    gaussians: int
    psnr: float
    work: int


@dataclass(frozen=True)
class ViewRoles:
    """Which views a run fits and which decide.

    Attributes:
        fitted: indices into the training views.
        kept_aside: indices into the training views, of those that decide and are not fitted.
        held_out_decide: whether the held-out views, by which the run will be judged, decide as well.
        reason: all this in plain words.
    """

    fitted: list[int]
    kept_aside: list[int]
    held_out_decide: bool
    reason: str


def assign_views(training: int, held_out: int) -> ViewRoles:
    """Deciding views for a capture of so many views: training views where there are enough, else held-out ones."""
    everything = list(range(training))
    if training >= MANY_VIEWS or (not held_out and training >= FEW_VIEWS):
        count = min(max(training // _ONE_IN, 1), _MOST_DECIDING)
        aside = sorted({int((i + 0.5) * training / count) for i in range(count)})
        fitted = [i for i in everything if i not in aside]
        were = "was" if count == 1 else "were"
        return ViewRoles(fitted, aside, False, f"{count} of {training} training views {were} kept aside to decide")
    if held_out:
        return ViewRoles(
            everything,
            [],
            True,
            f"the held-out views decided, because {training} training views are too few to keep some aside: "
            "figures on them are slightly flattering",
        )
    return ViewRoles(everything, [], False, f"nothing was decided: {training} views are too few to keep one aside")


def fit_all(training: int) -> ViewRoles:
    """All views are fitted, for a run that has nothing to decide."""
    return ViewRoles(list(range(training)), [], False, "there was nothing to decide")


@dataclass(frozen=True)
class GrowthRule:
    """When there are enough Gaussians.

    Attributes:
        doubling_gain: dB that a doubling of their number has to bring. Around their knee, peers gain 0.25 to 0.35 dB
            by one (FastGS 0.4 to 1.15 million, gsplat 1 to 2 million); here more is asked, since what training alone
            gains meanwhile counts in.
        work_gain: dB that a doubling of all the time spent so far has to bring.
        window: rounds over which a gain is taken, so that one noisy measurement does not decide.
        pixels_each: and never more than one Gaussian for so many pixels of the fitted views.
        fewest: which is never below this.
    """

    doubling_gain: float = 0.4
    work_gain: float = 0.4
    window: int = 2
    pixels_each: int = 100
    fewest: int = 1000

    def ceiling(self, pixels: int) -> int:
        """Most Gaussians that so many pixels can determine."""
        return max(pixels // self.pixels_each, self.fewest)

    def verdict(self, rounds: Sequence[Measurement]) -> str | None:
        """Why the last `window` rounds say that there are enough; None while growth pays."""
        if len(rounds) <= self.window:
            return None
        before, now = rounds[-1 - self.window], rounds[-1]
        gain = now.psnr - before.psnr
        doublings = math.log2(now.gaussians / before.gaussians)
        if doublings > _LEAST_DOUBLINGS and gain < self.doubling_gain * doublings:
            return f"a doubling brought {gain / doublings:.2f} dB, less than {self.doubling_gain:g}"
        doublings = math.log2(now.work / max(before.work, 1))
        if gain < self.work_gain * doublings:
            return f"a doubling of the time brought {gain / doublings:.2f} dB, less than {self.work_gain:g}"
        return None


@dataclass(frozen=True)
class StopRule:
    """When there were enough steps.

    Attributes:
        every: share of the run between two measurements.
        patience: share of the run without a new best after which it ends.
        least_gain: dB that make a new best.
    """

    every: float = 0.025
    patience: float = 0.25
    least_gain: float = 0.02

    def due(self, step: int, steps: int) -> bool:
        """Whether to measure after `step` of `steps`."""
        return step % max(round(self.every * steps), 1) == 0

    def enough(self, measured: Sequence[Measurement], steps: int) -> bool:
        """Whether nothing was gained for as long as `patience` says."""
        best, last_gain = -math.inf, 0
        for measurement in measured:
            if measurement.psnr > best + self.least_gain:
                best, last_gain = measurement.psnr, measurement.step
        return bool(measured) and measured[-1].step - last_gain >= self.patience * steps


@dataclass(frozen=True)
class HarmonicsRule:
    """When a higher degree of spherical harmonics pays.

    Attributes:
        highest: degree that is tried.
        steps: share of the run's steps that a trial takes, and `fewest_steps` at least.
        largest_share: of the run's steps; where a trial would take more, none is made. Such a run has not settled, and
            a higher degree would make up for that: a matte scene was given degree 2 after 450 steps.
        degree_gain: dB that a degree has to bring: it makes every Gaussian larger by a half and more.
        base_rate, rest_rate: step sizes of the degree-0 and the higher coefficients at a trial's start.
        rates_decay: what is left of them at its end.
    """

    highest: int = 3
    steps: float = 0.04
    fewest_steps: int = 120
    largest_share: float = 0.1
    degree_gain: float = 0.25
    base_rate: float = 2e-3
    rest_rate: float = 1e-2
    rates_decay: float = 0.1

    def trial_steps(self, steps: int) -> int:
        """Steps of a trial in a run of so many; 0 where the run is too short for one."""
        trial = max(round(self.steps * steps), self.fewest_steps)
        return trial if trial <= self.largest_share * steps else 0

    def rates(self, progress: float) -> LearningRates:
        """Step sizes of a trial: of the colours alone, so that what it gains is due to them."""
        left = self.rates_decay**progress
        return LearningRates(sh0=self.base_rate * left, sh_rest=self.rest_rate * left)
