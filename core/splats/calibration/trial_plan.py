"""The base of the plans of corrections, each of which is tried in two branches before it is applied."""

from __future__ import annotations


class TrialPlan:
    """How long a trial takes.

    Attributes:
        trial: share of the run's steps in each of the two branches of a trial, at least `fewest_trial_steps`.
    """

    trial: float
    fewest_trial_steps: int

    def trial_steps(self, steps: int) -> int:
        """Steps of each branch of a trial in a run of `steps`."""
        return max(round(self.trial * steps), self.fewest_trial_steps)
