"""Writes a comparison of enhancers: a row an image as CSV, and tables that can be read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

from ...color.held_colors import HELD_COLORS
from ..tables import markdown_table, number, write_csv
from .figures import figures_to_reach
from .image_sets import ImageSet
from .means import (
    CLASSES,
    EASY_ABOVE,
    HARD_BELOW,
    held_mean,
    kept_gain,
    mean,
    readable_plates,
    select,
)
from .scores import EnhancerScores
from .table import Comparison, TradeOff

_FIGURES = (
    ("CCPR", "ccpr", 3),
    ("mean", "ccpr_mean", 3),
    ("global", "ccpr_global", 3),
    ("CCFR", "ccfr", 3),
    ("SSIM to S", "ssim_simulated", 3),
    ("SSIM", "ssim", 3),
    ("PSNR", "psnr", 1),
    ("ΔE00", "delta_e_2000", 2),
    ("ΔE76", "delta_e_76", 2),
)

_LEGEND = (
    f"hard: CCPR of the input below {HARD_BELOW}; easy: above {EASY_ABOVE}; between: the others. CCPR, its mean over "
    "thresholds, global CCPR, CCFR and SSIM to S compare the original with the simulated (Machado) result; SSIM, PSNR "
    "and ΔE the original with the result itself. Kept: CCPR gain under another model over the gain under Machado."
)


def write_comparison(
    folder: Path, comparison: Comparison, image_sets: Sequence[ImageSet], candidate: str, description: str
) -> str:
    """Write ``enhancer.csv``, ``tradeoff.csv`` and ``enhancer.md``; returns the text of the latter.

    Args:
        folder: is made as needed.
        comparison: what was found.
        image_sets: what was looked at.
        candidate: label of the method that the headline is about.
        description: a sentence on images and settings.
    """
    write_csv(folder / "enhancer.csv", EnhancerScores, comparison.scores)
    write_csv(folder / "tradeoff.csv", TradeOff, comparison.trade_offs)
    lines = ["# Enhancers compared", "", description, ""]
    lines += _headline(comparison, image_sets, candidate)
    lines += ["", _LEGEND, ""]
    lines += _plates(comparison.scores)
    for image_set in image_sets:
        if any(image.figure is None for image in image_set.images):
            lines += _set_tables(comparison.scores, image_set)
    lines += _held(comparison.scores, image_sets)
    lines += ["## Seconds per megapixel", ""]
    lines += markdown_table(["method", "s/MP"], [[name, number(s, 3)] for name, s in comparison.seconds.items()])
    text = "\n".join(lines) + "\n"
    (folder / "enhancer.md").write_text(text, encoding="utf-8")
    return text


def _headline(comparison: Comparison, image_sets: Sequence[ImageSet], candidate: str) -> list[str]:
    photographs = [image_set.name for image_set in image_sets if image_set.photographs]
    figures = figures_to_reach(comparison.scores, candidate, photographs, comparison.seconds[candidate])
    title = [f"## Figures to reach: {candidate}, severity 1", ""]
    return title + markdown_table(["what", "type", "target", "measured", "reached"], [f.cells() for f in figures])


def _set_tables(scores: Sequence[EnhancerScores], image_set: ImageSet) -> list[str]:
    """One table an observer: classes of images by methods."""
    lines: list[str] = []
    models = {"vienot": "kept Viénot", "brettel": "kept Brettel"}
    models = {model: title for model, title in models.items() if not math.isnan(mean(scores, f"ccpr_{model}"))}
    header = ["images", "n", "method", "CCPR in", *(name for name, _, _ in _FIGURES), *models.values()]
    for cvd, severity, rows in _by_observer(select(scores, image_sets=[image_set.name])):
        body = []
        for kind, method in product((*CLASSES, None), _methods(rows)):
            mine = select(rows, method=method, kind=kind)
            if mine:
                body.append(
                    [
                        kind or "all",
                        str(len(mine)),
                        method,
                        number(mean(mine, "ccpr_input"), 3),
                        *(number(mean(mine, figure), digits) for _, figure, digits in _FIGURES),
                        *(number(kept_gain(mine, rows, model), 2) for model in models),
                    ]
                )
        lines += [f"## {image_set.name}: {cvd} {severity:g}", "", *markdown_table(header, body), ""]
    return lines


def _plates(scores: Sequence[EnhancerScores]) -> list[str]:
    plates = [row for row in scores if row.plate_before == row.plate_before]  # not NaN
    body = []
    for cvd, severity, rows in _by_observer(plates):
        for method in _methods(rows):
            mine = select(rows, method=method)
            figures = [mean(mine, "plate_before"), mean(mine, "plate_after"), 100.0 * readable_plates(mine)]
            change = mean(mine, "delta_e_76")
            body.append(
                [cvd, f"{severity:g}", method, str(len(mine)), *(number(value, 1) for value in (*figures, change))]
            )
    header = ["type", "severity", "method", "n", "ΔE76 before", "ΔE76 after", "readable %", "mean change ΔE76"]
    return ["## Plates: figure against ground through S", "", *markdown_table(header, body), ""] if body else []


def _held(scores: Sequence[EnhancerScores], image_sets: Sequence[ImageSet]) -> list[str]:
    photographs = [image_set.name for image_set in image_sets if image_set.photographs]
    body = []
    for cvd, severity, rows in _by_observer(select(scores, image_sets=photographs)):
        for method in _methods(rows):
            mine = select(rows, method=method)
            body.append([cvd, f"{severity:g}", method, *(number(held_mean(mine, color), 2) for color in HELD_COLORS)])
    header = ["type", "severity", "method", *HELD_COLORS]
    return ["## Held colours of the photographs: mean ΔE00", "", *markdown_table(header, body), ""] if body else []


def _by_observer(rows: Sequence[EnhancerScores]) -> Iterator[tuple[str, float, list[EnhancerScores]]]:
    for cvd, severity in dict.fromkeys((row.cvd, row.severity) for row in rows):
        yield cvd, severity, select(rows, cvd=cvd, severity=severity)


def _methods(rows: Sequence[EnhancerScores]) -> list[str]:
    return list(dict.fromkeys(row.method for row in rows))
