"""When a method counts as having failed; the criteria were fixed before anything was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..studies.recipe import Trial
from ..tables import frame_of
from .axes import HARMLESS
from .plan import StressResult

MOST_LOST = 3.0
"""dB of PSNR that a method may lose against its own harmless level."""
MOST_RWE = 1.0
"""Warping error relative to the photographs'; above it the views are less consistent than those."""

UNTOUCHED = "untouched"
"""The name of the harmless level that axes share, in place of an axis."""
_FIGURES = ["psnr", "rwe", "ccpr", "ccpr_input"]
_COLUMNS = (
    *("method", "axis", "level", "value", "seeds", "psnr", "psnr_deviation", "psnr_lost", "rwe", "rwe_deviation"),
    *("ccpr", "ccpr_deviation", "ccpr_input", "errors", "failed", "warnings"),
)


def standings(results: Sequence[StressResult]) -> pd.DataFrame:
    """The figures of every method at every level of every axis over the seeds, and why it fails.

    Returns:
        A row for each ``method``, ``axis`` (`UNTOUCHED` at the harmless level that axes share) and ``level``, with the
        level's ``value`` as text; ``seeds``, how many gave figures, the means of ``psnr``, ``rwe``, ``ccpr`` and
        ``ccpr_input`` over these, and the sample standard deviations ``psnr_deviation``, ``rwe_deviation`` and
        ``ccpr_deviation`` (NaN for a single seed); ``psnr_lost`` against the method's own harmless level; ``errors`` of
        any seed; ``failed``, all reasons for failure in words, empty if there are none; ``warnings`` that the product
        gave for any seed, separated by spaces.
    """
    attempts = [result.attempt for result in results]
    trials = frame_of(Trial, [result.trial for result in results]).assign(
        method=[attempt.method for attempt in attempts],
        axis=[attempt.axis.name if attempt.axis else UNTOUCHED for attempt in attempts],
        level=[attempt.level for attempt in attempts],
        value=[attempt.axis.text(attempt.level) if attempt.axis else "" for attempt in attempts],
    )
    rows = [_standing(*group) for group in trials.groupby(["axis", "method", "level"], sort=False)]
    harmless = {(row["axis"], row["method"]): row["psnr"] for row in rows if row["level"] == HARMLESS}
    for row in rows:
        usual = harmless.get((row["axis"], row["method"]), harmless[UNTOUCHED, row["method"]])
        row["psnr_lost"] = usual - row["psnr"]
        row["failed"] = "; ".join(filter(None, [row["errors"], *_exceeded(row)]))
    return pd.DataFrame(rows)[list(_COLUMNS)]


def _standing(key: tuple[str, str, int], trials: pd.DataFrame) -> dict[str, Any]:
    """One row without its verdict."""
    axis, method, level = key
    finite = np.isfinite(trials[_FIGURES]).all(axis=1)
    means, deviations = trials.loc[finite, _FIGURES].mean(), trials.loc[finite, _FIGURES].std()
    errors = sorted(set(trials.error) - {""})
    errors += ["a figure is not finite"] if ((trials.error == "") & ~finite).any() else []
    errors += ["a step was not finite"] if trials.skipped_steps.any() else []
    return {
        "method": method,
        "axis": axis,
        "level": level,
        "value": trials.value.iloc[0],
        "seeds": int(finite.sum()),
        **means,
        **{f"{name}_deviation": deviations[name] for name in ("psnr", "rwe", "ccpr")},
        "errors": "; ".join(errors),
        "warnings": " ".join(sorted({name for warnings in trials.warnings for name in warnings.split()})),
    }


def _exceeded(row: dict[str, Any]) -> list[str]:
    """The criteria that the means fail; comparisons with NaN are false, and errors speak for themselves."""
    found = []
    if row["psnr_lost"] > MOST_LOST:
        found.append(f"PSNR {row['psnr_lost']:.1f} dB lower")
    if row["rwe"] > MOST_RWE:
        found.append(f"RWE {row['rwe']:.2f}")
    if row["ccpr"] < row["ccpr_input"]:
        found.append(f"CCPR {row['ccpr']:.3f}, the input's is {row['ccpr_input']:.3f}")
    return found


def fails_by_the_line_of(method: str, items: pd.DataFrame) -> pd.Series:
    """Whether each row of `standings` fails if all methods have the PSNR to reach of one, `MOST_LOST` below its own.

    By its own line a method that is better on the untouched capture fails sooner than one that never was.
    """
    lines = items[items.method == method].assign(line=lambda own: own.psnr + own.psnr_lost - MOST_LOST)
    line = items.axis.map(lines.groupby("axis").line.max())
    stands = (items.psnr >= line) & (items.rwe <= MOST_RWE) & (items.ccpr >= items.ccpr_input) & (items.errors == "")
    return ~stands


def curve(items: pd.DataFrame, method: str, axis: str) -> pd.DataFrame:
    """A method's levels on an axis, in order, from the harmless one on: the axis's own, or the one that axes share."""
    mine = items[(items.method == method) & items.axis.isin([axis, UNTOUCHED])]
    own_first = mine.sort_values("axis", key=lambda name: name == UNTOUCHED, kind="stable")
    return own_first.drop_duplicates("level").sort_values("level")
