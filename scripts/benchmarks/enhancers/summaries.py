"""Two pages that sum up a comparison of enhancers: by other measures, and at every severity."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ..tables import Column, markdown_table, write_text
from .experts import AREA_BLUR, AREA_DISTANCE
from .image_sets import ImageSet
from .methods import LUT
from .report import mean, protected_mean, select, with_classes
from .scores import OTHER_MODELS

JUDGES_PAGE, SEVERITIES_PAGE = "judges.md", "severities.md"

_TIE = 0.001  # of a share, below which two are equal
_CONTRASTS = ("ccpr", "ccpr_global", "ccfr", "ssim_simulated")  # compared picture by picture
_ALL, _HARD = "all", "hard"
_WORST_MODEL = "ccpr_worst"
_KEYS: tuple[Column, ...] = (("severity", "severity", "g"), ("cvd", "type", ""), ("method", "method", ""))
_JUDGED: tuple[Column, ...] = (
    ("name_confusions", "names lost", ".3f"),
    ("cam_gap", "CAM gap", ".2f"),
    ("cam_change", "CAM change", ".2f"),
    ("chromatic_difference", r"Δa\*b\*", ".2f"),
    ("delta_e_2000", "ΔE00", ".2f"),
    ("ccpr_areas", "CCPR, areas", ".3f"),
    ("ccpr", "CCPR", ".3f"),
    (_WORST_MODEL, "worst model", ".3f"),
)
_SEVERITIES: tuple[Column, ...] = (
    ("n", "n", "d"),
    ("ccpr", "CCPR", ".3f"),
    ("ccpr_global", "global", ".3f"),
    ("ccfr", "CCFR", ".3f"),
    ("ssim_simulated", "SSIM to S", ".3f"),
    ("delta_e_2000", "ΔE00", ".2f"),
    ("grey", "greys", ".2f"),
    ("skin", "skin", ".2f"),
)
_JUDGES_LEGEND = (
    "Means over the pictures. Names lost: share of random pixel pairs with different basic colour names for normal "
    "vision that have one name as the observer sees the result; CAM gap: mean distance in CIECAM02-UCS between what "
    "the observer sees of the result and others of the original; CAM change, Δa\\*b\\*, ΔE00: between result and "
    f"original for others; CCPR, areas: of pairs {AREA_DISTANCE} pixels apart on pictures blurred by {AREA_BLUR:g}. "
    "Less is better of the first five, more of the others. Gain is plain contrast gain with the mean ΔE76 of the "
    "method it is named after. CVD-MET (2022) uses CIECAM02 as well; we had its abstract alone, and none of these "
    "figures is it."
)
_WORST_LEGEND = "Worst model: the least CCPR under those of Machado, Viénot and Brettel that describe the type."
_SEVERITIES_LEGEND = (
    "Means over the photographs; hard ones keep a CCPR below 0.9 without enhancement. Greys and skin: mean ΔE00 of "
    "such colours. The other columns as in the comparison."
)
_TIES_LEGEND = (
    f"The share of the photographs in which a method is not below the LUT (by more than {_TIE:g}), and in which it "
    "changes colours by no more ΔE00."
)


def write_summaries(folder: Path, scores: pd.DataFrame, image_sets: Sequence[ImageSet], description: str) -> None:
    """Write ``judges.md`` and, for photographs at several severities or one, ``severities.md``.

    Args:
        folder: created if needed.
        scores: rows of `Judge.score`.
        image_sets: the images.
        description: a sentence on images and settings.
    """
    scores = with_classes(scores)
    photographs = [image_set.name for image_set in image_sets if image_set.photographs]
    scores = scores.assign(group=scores.image_set.where(~scores.image_set.isin(photographs), "photographs"))
    models = scores[[f"ccpr_{model}" for model in OTHER_MODELS]].notna().any(axis=None)
    judged = [column for column in _JUDGED if models or column[0] != _WORST_MODEL]
    legend = f"{_JUDGES_LEGEND} {_WORST_LEGEND}" if models else _JUDGES_LEGEND
    lines = ["# The enhancers by other measures", "", description, "", legend, ""]
    strongest = select(scores, severity=scores.severity.max())
    for group, rows in strongest.groupby("group", sort=False):
        lines += [f"## {group}, severity {strongest.severity.max():g}", ""]
        lines += [*_table(rows, [*_KEYS[1:], ("n", "n", "d"), *judged], _judged), ""]
    write_text(folder / JUDGES_PAGE, lines)
    pictures = select(scores, group="photographs")
    if not pictures.empty:
        write_text(folder / SEVERITIES_PAGE, ["# Every severity", "", description, "", *_severities(pictures)])


def compared_with_lut(rows: pd.DataFrame) -> dict[str, float]:
    """In what share of the pictures a method is not below the LUT.

    Args:
        rows: of one method, with the LUT's figures of the same pictures in columns that end in ``_lut``.

    Returns:
        ``ccpr``, ``ccpr_global``, ``ccfr`` and ``ssim_simulated`` (not below), ``delta_e_2000`` (not above), among
        pictures where both have the figure.
    """
    found = {}
    for figure in (*_CONTRASTS, "delta_e_2000"):
        both = rows[[figure, f"{figure}_lut"]].dropna()
        better = both[figure] - both[f"{figure}_lut"]
        found[figure] = float((better <= _TIE if figure == "delta_e_2000" else better >= -_TIE).mean())
    return found


def _severities(rows: pd.DataFrame) -> Iterator[str]:
    yield from (_SEVERITIES_LEGEND, "")
    for kind in (_ALL, _HARD):
        some = rows if kind == _ALL else select(rows, kind=kind)
        if not some.empty:
            yield from (f"## {kind} photographs", "", *_table(some, [*_KEYS, *_SEVERITIES], _means), "")
    if LUT not in set(rows.method):
        return
    keys = ["image_set", "image", "cvd", "severity"]
    paired = rows.merge(select(rows, method=LUT), on=keys, suffixes=("", "_lut"))
    columns: list[Column] = [*_KEYS, ("n", "n", "d")]
    columns += [(name, title, ".2f") for name, title, _ in _SEVERITIES if name in (*_CONTRASTS, "delta_e_2000")]
    paired = paired[paired.method != LUT]
    yield from ("## Picture by picture against the LUT", "", _TIES_LEGEND, "")
    yield from (*_table(paired, columns, lambda mine: {"n": len(mine), **compared_with_lut(mine)}), "")


def _judged(rows: pd.DataFrame) -> dict[str, Any]:
    return {"n": len(rows), **{name: mean(rows, name) for name, _, _ in _JUDGED}}


def _means(rows: pd.DataFrame) -> dict[str, Any]:
    colors = {color: protected_mean(rows, color) for color in ("grey", "skin")}
    return {"n": len(rows), **{name: mean(rows, name) for name, _, _ in _SEVERITIES if name in rows}, **colors}


def _table(
    rows: pd.DataFrame, columns: Sequence[Column], figures: Callable[[pd.DataFrame], Mapping[str, Any]]
) -> list[str]:
    """A line for each severity, type and method that the columns name."""
    keys = [name for name, _, _ in _KEYS if name in {column for column, _, _ in columns}]
    body = [dict(zip(keys, key, strict=True)) | dict(figures(mine)) for key, mine in rows.groupby(keys, sort=False)]
    return markdown_table(pd.DataFrame(body), columns)
