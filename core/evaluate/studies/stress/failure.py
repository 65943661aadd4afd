"""When a method counts as having failed; fixed before anything was measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from ..recipe import Trial
from ..summary import Summary
from .axes import HARMLESS
from .plan import StressResult

MOST_LOST = 3.0
"""dB of PSNR that a method may lose against its own harmless level."""
MOST_RWE = 1.0
"""Warping error relative to the photographs': above it the views contradict each other more than those do."""

UNTOUCHED = "untouched"
"""What stands for an axis at the harmless level of those that share it."""
_FIGURES = ("psnr", "rwe", "ccpr", "ccpr_input")


@dataclass(frozen=True)
class Standing:
    """A method at a level: its figures over the seeds, and what it failed by.

    Attributes:
        method, axis, level: what was tried; axis is `UNTOUCHED` at the harmless level that axes share.
        value: the level's value as a text.
        seeds: how many gave figures.
        psnr, rwe, ccpr, ccpr_input: means over these.
        psnr_deviation, rwe_deviation, ccpr_deviation: sample standard deviations; NaN for a single seed.
        failed: by what, in words; empty where it stands.
        warnings: that the product gave with any seed, separated by spaces.
    """

    method: str
    axis: str
    level: int
    value: str
    seeds: int
    psnr: float
    psnr_deviation: float
    rwe: float
    rwe_deviation: float
    ccpr: float
    ccpr_deviation: float
    ccpr_input: float
    failed: str
    warnings: str


def standing(results: Sequence[StressResult], value: str, harmless_psnr: float) -> Standing:
    """Sum up the seeds of one method at one level.

    Args:
        value: of the level, as a text.
        harmless_psnr: mean PSNR of the method at the harmless level; NaN where that failed.
    """
    attempt = results[0].attempt
    trials = [result.trial for result in results]
    usable = [trial for trial in trials if _is_measured(trial)]
    psnr, rwe, ccpr, ccpr_input = (Summary.of(getattr(trial, name) for trial in usable) for name in _FIGURES)
    found = Standing(
        method=attempt.method,
        axis=attempt.axis.name if attempt.axis else UNTOUCHED,
        level=attempt.level,
        value=value,
        seeds=len(usable),
        psnr=psnr.mean,
        psnr_deviation=psnr.deviation,
        rwe=rwe.mean,
        rwe_deviation=rwe.deviation,
        ccpr=ccpr.mean,
        ccpr_deviation=ccpr.deviation,
        ccpr_input=ccpr_input.mean,
        failed="",
        warnings=" ".join(sorted({name for trial in trials for name in trial.warnings.split()})),
    )
    return replace(found, failed="; ".join([*_errors(trials), *_beyond(found, harmless_psnr)]))


def standings(results: Sequence[StressResult]) -> list[Standing]:
    """Of every method at every level of every axis, the harmless level first."""
    groups: dict[tuple[str, str, int], list[StressResult]] = {}
    for result in results:
        attempt = result.attempt
        name = attempt.axis.name if attempt.axis else UNTOUCHED
        groups.setdefault((name, attempt.method, attempt.level), []).append(result)
    harmless = {
        (name, method): Summary.of(result.trial.psnr for result in group if _is_measured(result.trial)).mean
        for (name, method, level), group in groups.items()
        if level == HARMLESS
    }
    return [
        standing(
            group,
            axis.text(level) if (axis := group[0].attempt.axis) else "",
            harmless.get((name, method), harmless[UNTOUCHED, method]),
        )
        for (name, method, level), group in groups.items()
    ]


def first_failure(levels: Iterable[Standing]) -> Standing | None:
    """The lowest level at which a method fails, of its levels on one axis; None where it stands on all."""
    return next((item for item in sorted(levels, key=lambda item: item.level) if item.failed), None)


def _errors(trials: Sequence[Trial]) -> list[str]:
    found = sorted({trial.error for trial in trials if trial.error})
    if any(not trial.error and not _is_measured(trial) for trial in trials):
        found.append("a figure is not finite")
    if any(trial.skipped_steps for trial in trials):
        found.append("a step was not finite")
    return found


def _beyond(item: Standing, harmless_psnr: float) -> list[str]:
    """Which lines the means are beyond; comparisons with NaN are false, and errors speak for themselves."""
    found = []
    if harmless_psnr - item.psnr > MOST_LOST:
        found.append(f"PSNR {harmless_psnr - item.psnr:.1f} dB lower")
    if item.rwe > MOST_RWE:
        found.append(f"RWE {item.rwe:.2f}")
    if item.ccpr < item.ccpr_input:
        found.append(f"CCPR {item.ccpr:.3f}, the input's is {item.ccpr_input:.3f}")
    return found


def _is_measured(trial: Trial) -> bool:
    return all(math.isfinite(getattr(trial, name)) for name in _FIGURES)
