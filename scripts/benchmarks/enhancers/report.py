"""The report of a comparison of enhancers: the targets on images that no training saw, tables, and rows as CSV."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ....core.color.protected_colors import PROTECTED_COLORS
from ..tables import Column, markdown_table, number, write_csv, write_text
from .image_sets import ImageSet
from .methods import LUT, NONE, gain_label

READABLE_DELTA_E = 10.0
"""Least simulated ΔE76 between figure and ground at which a plate can be read; common practice for map palettes."""
HARD_BELOW, EASY_ABOVE = 0.9, 0.97
"""CCPR of the unenhanced image: hard ones need help, easy ones should stay as they are."""
CLASSES = ("hard", "between", "easy")
_LEAST_GAIN = 0.005  # CCPR; below it, the share kept under another model is meaningless

# The targets.
READABLE_SHARE, PLATE_MEAN = 0.95, 20.0
LEAST_CCPR_GAIN = 0.05
MOST_SSIM_LOSS = 0.01
EASY_SSIM, EASY_PSNR = 0.975, 34.0
PROTECTED_DELTA_E = 1.5
KEPT_GAIN = 0.7
SECONDS_PER_MEGAPIXEL = 0.9
_PLATE_TYPES = ("protan", "deutan")
_FULL = 1.0  # severity of the headline

_MODELS = {"vienot": "Viénot", "brettel": "Brettel"}
_OBSERVER: tuple[Column, ...] = (("cvd", "type", ""), ("severity", "severity", "g"), ("method", "method", ""))
_FIGURES: tuple[Column, ...] = (
    ("ccpr_input", "CCPR in", ".3f"),
    ("ccpr", "CCPR", ".3f"),
    ("ccpr_mean", "mean", ".3f"),
    ("ccpr_global", "global", ".3f"),
    ("ccfr", "CCFR", ".3f"),
    ("ssim_simulated", "SSIM to S", ".3f"),
    ("ssim", "SSIM", ".3f"),
    ("psnr", "PSNR", ".1f"),
    ("delta_e_2000", "ΔE00", ".2f"),
    ("delta_e_76", "ΔE76", ".2f"),
)
_PLATES: tuple[Column, ...] = (
    ("n", "n", "d"),
    ("plate_before", "ΔE76 before", ".1f"),
    ("plate_after", "ΔE76 after", ".1f"),
    ("readable", "readable %", ".1f"),
    ("delta_e_76", "mean change ΔE76", ".1f"),
)
_LEGEND = (
    f"hard: CCPR of the input below {HARD_BELOW}; easy: above {EASY_ABOVE}; between: the others. CCPR (τ = 6), its "
    "mean over thresholds, global CCPR, CCFR and SSIM to S compare the original with the simulated (Machado) result; "
    "SSIM, PSNR and ΔE the original with the result itself. Kept: CCPR gain under another model over the gain under "
    "Machado."
)


def write_comparison(
    folder: Path,
    scores: pd.DataFrame,
    trade_offs: pd.DataFrame,
    seconds: Mapping[str, float],
    image_sets: Sequence[ImageSet],
    candidate: str,
    description: str,
) -> str:
    """Write ``enhancer.csv``, ``tradeoff.csv`` and ``enhancer.md``; returns the text of the latter.

    Args:
        folder: created if needed.
        scores: rows of `Judge.score`.
        trade_offs: rows with the columns `TRADE_OFFS` of `comparison`.
        seconds: per megapixel, by the label of the method.
        image_sets: the images.
        candidate: label of the method that the headline is about.
        description: a sentence on images and settings.
    """
    write_csv(folder / "enhancer.csv", scores)
    write_csv(folder / "tradeoff.csv", trade_offs)
    scores = with_classes(scores)
    photographs = [image_set.name for image_set in image_sets if image_set.photographs]
    targets = targets_of(scores, candidate, photographs, seconds[candidate])
    lines = ["# Enhancers compared", "", description, "", f"## Figures to reach: {candidate}, severity 1", ""]
    lines += markdown_table(targets, [(name, name, ".3f" if name == "measured" else "") for name in targets])
    plates = scores[scores.plate_before.notna()]
    lines += ["", _LEGEND, "", *_section("Plates: figure against ground through S", plates, _PLATES, _of_plates)]
    for image_set in image_sets:
        if any(image.figure is None for image in image_set.images):
            lines += _set_tables(select(scores, image_set=image_set.name), scores)
    title = "Protected colours of the photographs: mean ΔE00"
    colors = [(color, color, ".2f") for color in PROTECTED_COLORS]
    rows = scores[scores.image_set.isin(photographs)]
    lines += _section(title, rows, colors, lambda mine: {name: protected_mean(mine, name) for name, _, _ in colors})
    times = pd.DataFrame(seconds.items(), columns=["method", "seconds"])
    columns = [("method", "method", ""), ("seconds", "s/MP", ".3f")]
    return write_text(folder / "enhancer.md", [*lines, "## Seconds per megapixel", "", *markdown_table(times, columns)])


def _set_tables(rows: pd.DataFrame, every_row: pd.DataFrame) -> list[str]:
    """A table for each observer: classes of images by methods."""
    lines: list[str] = []
    kept: list[Column] = [
        (f"kept_{m}", f"kept {title}", ".2f") for m, title in _MODELS.items() if every_row[f"ccpr_{m}"].notna().any()
    ]
    columns: list[Column] = [("kind", "images", ""), ("n", "n", "d"), ("method", "method", ""), *_FIGURES, *kept]
    for (cvd, severity), seen in rows.groupby(["cvd", "severity"], sort=False):
        body: list[dict[str, Any]] = []
        for kind in (*CLASSES, "all"):
            some = seen if kind == "all" else select(seen, kind=kind)
            for method, mine in some.groupby("method", sort=False):
                means = {name: mean(mine, name) for name, _, _ in _FIGURES}
                gains = {f"kept_{model}": kept_gain(mine, seen, model) for model in _MODELS}
                body.append({"kind": kind, "n": len(mine), "method": method, **means, **gains})
        table = markdown_table(pd.DataFrame(body), columns)
        lines += [f"## {seen.image_set.iloc[0]}: {cvd} {severity:g}", "", *table, ""]
    return lines


def _section(
    title: str, rows: pd.DataFrame, columns: Sequence[Column], figures: Callable[[pd.DataFrame], dict[str, float]]
) -> list[str]:
    """A table with a row for each observer and method; nothing without rows."""
    if rows.empty:
        return []
    keys = [name for name, _, _ in _OBSERVER]
    body = [dict(zip(keys, key, strict=True)) | figures(mine) for key, mine in rows.groupby(keys, sort=False)]
    return [f"## {title}", "", *markdown_table(pd.DataFrame(body), [*_OBSERVER, *columns]), ""]


def _of_plates(rows: pd.DataFrame) -> dict[str, float]:
    means = {name: mean(rows, name) for name in ("plate_before", "plate_after", "delta_e_76")}
    return {"n": len(rows), "readable": 100.0 * readable_plates(rows), **means}


def targets_of(scores: pd.DataFrame, candidate: str, photographs: Sequence[str], seconds: float) -> pd.DataFrame:
    """The headline for a method: severity 1, plates, and the photographs of all sets together.

    Args:
        scores: with their classes.
        candidate: label of the method.
        photographs: names of the sets of photographs.
        seconds: the candidate's, per megapixel.

    Returns:
        ``what`` was measured, ``type`` of the observer, ``target``, ``measured`` and ``reached``, as texts.
    """
    targets: list[dict[str, str]] = []
    full = select(scores, severity=_FULL)
    types = list(dict.fromkeys(full.cvd))
    for cvd in [cvd for cvd in types if cvd in _PLATE_TYPES]:
        plates = select(full, method=candidate, cvd=cvd)
        targets.append(_at_least("plates readable, share", cvd, READABLE_SHARE, readable_plates(plates), 2))
        targets.append(_at_least("plates, mean ΔE76 through S", cvd, PLATE_MEAN, mean(plates, "plate_after"), 1))
    for cvd in types:
        rows = select(full[full.image_set.isin(photographs)], cvd=cvd)
        mine = select(rows, method=candidate)
        targets += _of_hard_photographs(select(rows, kind="hard"), candidate, cvd)
        easy = select(mine, kind="easy")
        targets.append(_at_least("easy photographs, SSIM to the original", cvd, EASY_SSIM, mean(easy, "ssim")))
        targets.append(_at_least("easy photographs, PSNR to the original, dB", cvd, EASY_PSNR, mean(easy, "psnr"), 1))
        for color in PROTECTED_COLORS:
            what, error = f"ΔE00 of {color} areas", protected_mean(mine, color)
            targets.append(_at_most(what, cvd, PROTECTED_DELTA_E, error))
        for model, title in _MODELS.items():
            share = kept_gain(select(mine, kind="hard"), rows, model)
            if not (math.isnan(share) and cvd == "tritan" and model == "vienot"):
                targets.append(_at_least(f"CCPR gain kept under {title}", cvd, KEPT_GAIN, share, 2))
    return pd.DataFrame([*targets, _at_most("seconds per megapixel", "", SECONDS_PER_MEGAPIXEL, seconds)])


def _of_hard_photographs(hard: pd.DataFrame, candidate: str, cvd: str) -> list[dict[str, str]]:
    """Contrast and similarity, compared with the controls on the same images."""

    def of(method: str, figure: str) -> float:
        return mean(select(hard, method=method), figure)

    contrast = {
        "none + 0.05": of(NONE, "ccpr") + LEAST_CCPR_GAIN,
        "LUT": of(LUT, "ccpr"),
        "gain at its ΔE76": of(gain_label(candidate), "ccpr"),
    }
    similarity = {"none - 0.01": of(NONE, "ssim_simulated") - MOST_SSIM_LOSS, "LUT": of(LUT, "ssim_simulated")}
    return [
        _at_least(f"{what}, hard photographs, against {name}", cvd, bound, of(candidate, figure))
        for what, figure, bounds in (("CCPR", "ccpr", contrast), ("SSIM to simulated", "ssim_simulated", similarity))
        for name, bound in bounds.items()
    ]


def _at_least(what: str, cvd: str, bound: float, measured: float, digits: int = 3) -> dict[str, str]:
    return _target(what, cvd, "≥", bound, measured, digits, reached=measured >= bound)


def _at_most(what: str, cvd: str, bound: float, measured: float) -> dict[str, str]:
    return _target(what, cvd, "≤", bound, measured, 2, reached=measured <= bound)


def _target(
    what: str, cvd: str, sign: str, bound: float, measured: float, digits: int, *, reached: bool
) -> dict[str, str]:
    bound_text, measured_text = (number(value, f".{digits}f") for value in (bound, measured))
    verdict = "–" if math.isnan(bound) or math.isnan(measured) else "yes" if reached else "**no**"
    return {"what": what, "type": cvd, "target": f"{sign} {bound_text}", "measured": measured_text, "reached": verdict}


def with_classes(scores: pd.DataFrame) -> pd.DataFrame:
    """The scores with ``kind``, the `image_class` of each image."""
    return scores.assign(kind=scores.ccpr_input.map(image_class))


def image_class(ccpr_input: float) -> str:
    """One of `CLASSES` by the CCPR of the unenhanced image; "undefined" if no neighbours are distinct."""
    if math.isnan(ccpr_input):
        return "undefined"
    if ccpr_input < HARD_BELOW:
        return "hard"
    return "easy" if ccpr_input > EASY_ABOVE else "between"


def select(rows: pd.DataFrame, **values: Any) -> pd.DataFrame:
    """The rows with these values in the columns of these names."""
    for name, value in values.items():
        rows = rows[rows[name] == value]
    return rows


def mean(rows: pd.DataFrame, figure: str) -> float:
    """Mean of a figure over the rows that have it. Infinite ones (PSNR of equal images) count only if all are."""
    values = rows[figure].dropna()
    finite = values[np.isfinite(values)]
    if len(finite):
        return float(finite.mean())
    return float(values.iloc[0]) if len(values) else math.nan


def protected_mean(rows: pd.DataFrame, color: str) -> float:
    """Mean ΔE00 over all pixels of a protected colour, however they are distributed over the images."""
    pixels, errors = rows[f"{color}_pixels"], rows[f"{color}_delta_e"]
    return float((pixels * errors.fillna(0.0)).sum() / pixels.sum()) if pixels.sum() > 0 else math.nan


def kept_gain(rows: pd.DataFrame, every_row: pd.DataFrame, model: str) -> float:
    """Share of the CCPR gain that remains under another simulation model.

    The gain is that of the means over the images, because the ratio of an image's small gains says little.

    Args:
        rows: of one method.
        every_row: includes those of the unenhanced images.
        model: "machado", "vienot" or "brettel".

    Returns:
        NaN if it does not apply or there is no gain to keep.
    """
    keys = ["image_set", "image", "cvd", "severity"]
    before = rows[keys].merge(select(every_row, method=NONE), on=keys)
    gain = mean(rows, "ccpr") - mean(before, "ccpr")
    figure = "ccpr" if model == "machado" else f"ccpr_{model}"
    return (mean(rows, figure) - mean(before, figure)) / gain if gain >= _LEAST_GAIN else math.nan


def readable_plates(rows: pd.DataFrame) -> float:
    """Share of the plates that the observer can read; NaN without plates."""
    after = rows.plate_after.dropna()
    return float((after >= READABLE_DELTA_E).mean()) if len(after) else math.nan
