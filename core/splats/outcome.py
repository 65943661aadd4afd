"""What a run has decided so far, the best it has been, and how to say so."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .decisions import Measurement
from .fitting import Fit
from .gaussians import Gaussians
from .plan import TrainingPlan

# A few deciding views scatter by so much from one measurement to the next; less is no reason to go back.
_WORTH_GOING_BACK = 0.15  # dB


@dataclass
class Outcome:
    """Gathered while a run goes on.

    Attributes:
        views: in plain words, which views decide.
        strategy: its name.
        measured: by the deciding views, at regular steps.
        rounds: by them, before each refinement.
        growth, degree: verdicts in plain words, empty where there is none.
        stopped: the step at which nothing more was gained, or None.
    """

    views: str
    strategy: str
    measured: list[Measurement] = field(default_factory=list)
    rounds: list[Measurement] = field(default_factory=list)
    growth: str = ""
    degree: str = ""
    stopped: int | None = None
    _best: tuple[Measurement, Gaussians] | None = None
    _words: dict[str, Any] = field(default_factory=dict)

    def at_round(self, measurement: Measurement) -> list[Measurement]:
        """All measurements before refinements, with this one."""
        self.rounds.append(measurement)
        return self.rounds

    def keep_if_best(self, measurement: Measurement, fit: Fit) -> None:
        """Keep a copy of the Gaussians when no measurement was better."""
        if self._best is None or measurement.psnr > self._best[0].psnr:
            self._best = measurement, fit.parameters.to_gaussians()

    def return_to_best(self, now: Measurement, fit: Fit) -> None:
        """Put the best Gaussians back, unless those of `now` are as good."""
        if self._best is None or self._best[0].psnr < now.psnr + _WORTH_GOING_BACK:
            return
        best, gaussians = self._best
        fit.restart(gaussians)
        gain = best.psnr - now.psnr
        self._words["restored"] = f"the Gaussians of step {best.step}, which were {gain:.2f} dB better, were taken"

    def in_words(self, plan: TrainingPlan, step: int, initial: int, fit: Fit) -> dict[str, Any]:
        """For the report; `step` is the last one that was run."""
        count = f"{initial:,} at the start, {len(fit):,} at the end"
        if plan.limit is not None:
            gaussians = f"{count}; at most {plan.limit:,} were asked for"
        else:
            gaussians = f"{count}; " + (self.growth or "growth paid as long as it was planned")
        steps = f"{step:,} of {plan.steps:,}"
        if self.stopped is not None:
            steps += ": the deciding views gained nothing any more"
        degree = fit.parameters.sh_count**0.5 - 1
        return {
            "strategy": self.strategy,
            "views": self.views,
            "gaussians": gaussians,
            "steps": steps,
            "sh_degree": f"{degree:.0f}" + (f": {self.degree}" if self.degree else ""),
            **self._words,
        }
