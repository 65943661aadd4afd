"""Decisions by trial: two ways to go on from the same Gaussians, and what the validation views gain by one of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

from ..gaussians import Gaussians
from ..raster import LearningRates
from .decisions import GrowthRule, GrowthTrial, ShDegreeRule
from .fitting import Fit

T = TypeVar("T")


def try_correction(fit: Fit, branch: Callable[[bool], float], settle: Callable[[float], bool]) -> bool:
    """Whether a correction is worthwhile; `fit` is left at the end of the branch that is chosen.

    Args:
        branch: fits with or without the correction for a while; returns the PSNR of the validation views.
        settle: told the dB that the correction gains, at the end of the branch that corrects; says whether to keep it.
    """
    start = fit.parameters.to_gaussians()
    return _second_is_kept(fit, (start, start), branch, lambda without, corrected: settle(corrected - without))


def more_pay(
    fit: Fit, rule: GrowthRule, steps: int, grown: Gaussians, branch: Callable[[int], tuple[float, float]]
) -> tuple[bool, str]:
    """Whether `grown` are worth more than the Gaussians of `fit` in a run of `steps`, and what they gained, in words.

    `fit` is left at the end of the branch that is chosen; there are no words without a trial.

    Args:
        branch: fits for so many steps; returns PSNR and CCPR of the validation views.
    """
    trial = rule.trial_steps(steps)
    if not trial or not rule.tells(len(fit), len(grown)):
        return False, ""
    start, words = fit.parameters.to_gaussians(), ""
    doublings = math.log2(len(grown) / len(start))

    def pays(fewer: tuple[float, float], more: tuple[float, float]) -> bool:
        nonlocal words
        psnr, contrast = ((after - before) / doublings for before, after in zip(fewer, more, strict=True))
        gained = GrowthTrial(psnr, contrast)
        words = gained.words
        return rule.pays(gained)

    kept = _second_is_kept(fit, (start, grown), lambda _: branch(trial), pays)
    return kept, words


def _second_is_kept(
    fit: Fit, starts: tuple[Gaussians, Gaussians], branch: Callable[[bool], T], prefers: Callable[[T, T], bool]
) -> bool:
    """Whether the second of two branches is preferred; `fit` goes on from the end of the preferred one.

    Args:
        branch: fits for a while from one of the `starts`, the second if it is told so; returns what is compared.
        prefers: whether the second, at whose end it is asked.
    """
    fit.restart(starts[0])
    first = branch(False)
    end_of_first = fit.state
    fit.restart(starts[1])
    kept = prefers(first, branch(True))
    if not kept:
        fit.state = end_of_first
    return kept


def choose_degree(
    fit: Fit, rule: ShDegreeRule, steps: int, fit_next: Callable[[LearningRates], None], measure: Callable[[], float]
) -> str:
    """Raise the SH degree as long as the validation views gain enough from it in a trial; returns why, in words.

    Args:
        steps: of the run.
        fit_next: fits the next view.
        measure: PSNR of the validation views.
    """
    if not rule.trial_steps(steps):
        return "the run is too short to try a higher one"
    chosen, start, words = fit.state, fit.parameters.to_gaussians(), ""

    def after_trial(degree: int) -> float:
        """Always from the same start, of the same length, and of the colours alone."""
        fit.restart(start.with_sh_degree(degree))
        trial = rule.trial_steps(steps)
        for number in range(trial):
            fit_next(rule.learning_rates(number / trial))
        return measure()

    before = after_trial(0)
    for degree in range(1, rule.highest + 1):
        after = after_trial(degree)
        words = f"degree {degree} gained {after - before:.2f} dB in a trial"
        if after - before < rule.degree_gain:
            words += f", less than {rule.degree_gain:g}"
            break
        before, chosen = after, fit.state
    fit.state = chosen
    return words
