"""How a training run goes: when it grows, at which resolution, with which step sizes, and when it ends."""

from __future__ import annotations

from .plan import TrainingPlan
from .raster import LearningRates
from .strategy import Schedule


class Course:
    """The schedule of one run, which growth may leave early.

    A run grows for a share of its steps and settles in the rest, with ever smaller steps. Growth may end early.

    Attributes:
        steps: the run's length.
        grown: step at which growth ended early, or None.
    """

    def __init__(self, plan: TrainingPlan, schedule: Schedule) -> None:
        self._plan = plan
        self._schedule = schedule
        self.steps = plan.steps
        self.grown: int | None = None

    def end_growth(self, step: int) -> None:
        """Nothing is added after `step`; the rest settles."""
        self.grown = step

    def due(self, step: int) -> bool:
        """Whether the set of Gaussians changes after `step`."""
        return self.grown is None and self._schedule.due(step, self._plan.steps)

    def growing(self, step: int) -> bool:
        """Whether it may still change at `step` or later."""
        return self.grown is None and self._schedule.growing(step, self._plan.steps)

    def reduction(self, step: int) -> int:
        """The level of the views at `step`."""
        coarse = self._plan.coarse
        return next((factor for until, factor in coarse if step <= until * self._plan.steps), 1)

    @property
    def coarsest(self) -> int:
        """The largest reduction there is."""
        return max((factor for _, factor in self._plan.coarse), default=1)

    def fine_since(self, step: int) -> int:
        """Steps at full resolution up to `step`."""
        return max(step - round(max((until for until, _ in self._plan.coarse), default=0.0) * self._plan.steps), 0)

    def progress(self, step: int) -> float:
        """What the step sizes go by: the share of the run, from 0 to 1."""
        return step / self.steps

    def rates(self, step: int) -> LearningRates:
        """The step sizes at `step`."""
        return self._plan.rates_at(self.progress(step))
