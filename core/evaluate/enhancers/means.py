"""Means over the rows of a comparison of enhancers, and what is derived from them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from .methods import NONE
from .scores import EnhancerScores

READABLE_DELTA_E = 10.0
"""ΔE76 between figure and ground, seen through S, from which a plate can be read: what map palettes keep."""

HARD_BELOW, EASY_ABOVE = 0.9, 0.97
"""CCPR of the unenhanced image: hard ones need help, easy ones had better stay as they are."""

CLASSES = ("hard", "between", "easy")

_LEAST_GAIN = 0.005  # CCPR; below it the share that another model keeps says nothing


def image_class(ccpr_input: float) -> str:
    """One of `CLASSES` by the CCPR of the unenhanced image; "undefined" where no neighbours are distinct."""
    if math.isnan(ccpr_input):
        return "undefined"
    if ccpr_input < HARD_BELOW:
        return "hard"
    return "easy" if ccpr_input > EASY_ABOVE else "between"


def select(
    rows: Iterable[EnhancerScores],
    *,
    method: str | None = None,
    kind: str | None = None,
    cvd: str | None = None,
    severity: float | None = None,
    image_sets: Sequence[str] | None = None,
) -> list[EnhancerScores]:
    """The rows that fulfil every condition that is not None; `kind` is a class of images."""
    return [
        row
        for row in rows
        if (method is None or row.method == method)
        and (kind is None or image_class(row.ccpr_input) == kind)
        and (cvd is None or row.cvd == cvd)
        and (severity is None or row.severity == severity)
        and (image_sets is None or row.image_set in image_sets)
    ]


def mean(rows: Sequence[EnhancerScores], figure: str) -> float:
    """Mean of a figure over the rows that have it. Infinite ones (PSNR of equal images) count only where all are."""
    values = np.array([getattr(row, figure) for row in rows], np.float64)
    values = values[~np.isnan(values)]
    finite = values[np.isfinite(values)]
    if len(finite):
        return float(finite.mean())
    return float(values[0]) if len(values) else math.nan


def held_mean(rows: Sequence[EnhancerScores], color: str) -> float:
    """Mean ΔE00 over all pixels of a held colour, however they are spread over the images."""
    pixels = np.array([getattr(row, f"{color}_pixels") for row in rows], np.float64)
    errors = np.array([getattr(row, f"{color}_delta_e") for row in rows], np.float64)
    return float((pixels * np.nan_to_num(errors)).sum() / pixels.sum()) if pixels.sum() > 0 else math.nan


def kept_gain(rows: Sequence[EnhancerScores], every_row: Sequence[EnhancerScores], model: str) -> float:
    """Share of the CCPR gain that is left when another simulation model judges.

    The gain is that of the means over the rows' images, because a ratio of an image's small gains says little.

    Args:
        rows: of one method.
        every_row: where the rows of the unenhanced images are.
        model: "machado", "vienot" or "brettel". NaN where it does not apply or there is no gain to keep.
    """
    untouched = {_key(row): row for row in every_row if row.method == NONE}
    before = [untouched[_key(row)] for row in rows]
    gain = mean(rows, "ccpr") - mean(before, "ccpr")
    figure = "ccpr" if model == "machado" else f"ccpr_{model}"
    if not gain >= _LEAST_GAIN:
        return math.nan
    return (mean(rows, figure) - mean(before, figure)) / gain


def readable_plates(rows: Sequence[EnhancerScores]) -> float:
    """Share of plates that can be read through S; NaN without plates."""
    after = np.array([row.plate_after for row in rows if not math.isnan(row.plate_after)])
    return float((after >= READABLE_DELTA_E).mean()) if len(after) else math.nan


def _key(row: EnhancerScores) -> tuple[str, str, str, float]:
    return row.image_set, row.image, row.cvd, row.severity
