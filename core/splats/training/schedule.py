"""The schedule of a training run: when it densifies, at which resolution and with which learning rates."""

from __future__ import annotations

from ...files.states import SavedState, State
from ..raster import LearningRates
from ..strategy import Schedule
from .plan import TrainingPlan


class TrainingSchedule:
    """The schedule of one run: growth in its first part, then fine-tuning at falling learning rates.

    Args:
        plan: of the run.
        densification: when the strategy refines.

    Attributes:
        means_reach: factor of the learning rate of the means (`start.means_reach`).
    """

    def __init__(self, plan: TrainingPlan, densification: Schedule) -> None:
        self._plan = plan
        self._densification = densification
        self._growth_ended = False
        self._skipped = 0  # steps in the middle of the run
        self.means_reach = 1.0

    def snapshot(self) -> State:
        """What `restore` continues from."""
        return {"growth_ended": self._growth_ended, "means_reach": self.means_reach, "skipped": self._skipped}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is something else."""
        self._growth_ended, self.means_reach = saved.value("growth_ended", bool), saved.value("means_reach", float)
        self._skipped = saved.number("skipped", 0, self._plan.steps)

    @property
    def steps(self) -> int:
        """The run's length."""
        return self._plan.steps - self._skipped

    def end_growth(self) -> None:
        """Stop densifying for good, earlier than planned."""
        self._growth_ended = True

    def skip_to_contrast(self, step: int) -> None:
        """After `step`, go on with the part of the run in which the contrast hinge counts, unless it has begun."""
        self._skipped = max(round(self._plan.contrast_from * self._plan.steps) - step, self._skipped)

    def refines(self, step: int) -> bool:
        """Whether to refine the set of Gaussians after `step`."""
        return not self._growth_ended and self._densification.due(step + self._skipped, self._plan.steps)

    def growing(self, step: int) -> bool:
        """Whether Gaussians may still be added at `step` or later."""
        return not self._growth_ended and self._densification.growing(step + self._skipped, self._plan.steps)

    def reduction(self, step: int) -> int:
        """The factor by which views are reduced at `step`."""
        reached = step + self._skipped
        return next((factor for until, factor in self._plan.coarse if reached <= until * self._plan.steps), 1)

    @property
    def coarsest(self) -> int:
        """The largest factor by which views are reduced."""
        return max((factor for _, factor in self._plan.coarse), default=1)

    def at_full_resolution(self, step: int) -> bool:
        """Whether there have been steps at full resolution up to `step`."""
        coarse_until = max((until for until, _ in self._plan.coarse), default=0.0)
        return step + self._skipped > round(coarse_until * self._plan.steps)

    def contrast(self, step: int) -> bool:
        """Whether the contrast hinge counts at `step`."""
        return self.progress(step) > self._plan.contrast_from and self.reduction(step) == 1

    def progress(self, step: int) -> float:
        """The share of the planned run done, or skipped, after `step`, from 0 to 1."""
        return (step + self._skipped) / self._plan.steps

    def learning_rates(self, step: int) -> LearningRates:
        """The learning rates at `step`."""
        return self._plan.learning_rates_at(self.progress(step), self.means_reach)


def due(every: int, step: int) -> bool:
    """Whether something that is done every so many steps, or never (0), is done after `step`."""
    return every > 0 and step % every == 0
