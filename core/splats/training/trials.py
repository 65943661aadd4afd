"""Decisions by trial: two ways to go on from the same Gaussians, and what the validation views gain by one of them."""

from __future__ import annotations

import math
from collections.abc import Callable

from ..gaussians import Gaussians
from ..raster import Adam, LearningRates, ParameterSet
from .decisions import GrowthRule, GrowthTrial, ShDegreeRule
from .fitting import Fit


def try_correction(fit: Fit, branch: Callable[[bool], float], settle: Callable[[float], bool]) -> bool:
    """Whether a correction is worthwhile; `fit` is left at the end of the branch that is chosen, so no step is lost.

    Args:
        branch: fits with or without the correction for a while; returns the PSNR of the validation views.
        settle: told the dB that the correction gains, at the end of the branch that corrects; says whether to keep it.
    """
    start = fit.parameters.to_gaussians()
    fit.restart(start)
    without = branch(False)
    uncorrected = fit.state
    fit.restart(start)
    kept = settle(branch(True) - without)
    if not kept:
        fit.state = uncorrected
    return kept


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
    fewer, gained = growth_gain(fit, grown, lambda: branch(trial))
    if not rule.pays(gained):
        fit.state = fewer
    return rule.pays(gained), gained.words


def growth_gain(
    fit: Fit, grown: Gaussians, branch: Callable[[], tuple[float, float]]
) -> tuple[tuple[ParameterSet, Adam], GrowthTrial]:
    """What more Gaussians gain, after the state of `fit` at the end of the branch without them.

    `fit` is left at the end of the branch that has them.

    Args:
        grown: more of them than `fit` has.
        branch: fits for a while; returns PSNR and CCPR of the validation views.
    """
    start = fit.parameters.to_gaussians()
    doublings = math.log2(len(grown) / len(start))
    fit.restart(start)
    psnr, contrast = branch()
    fewer = fit.state
    fit.restart(grown)
    grown_psnr, grown_contrast = branch()
    return fewer, GrowthTrial((grown_psnr - psnr) / doublings, (grown_contrast - contrast) / doublings)


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
