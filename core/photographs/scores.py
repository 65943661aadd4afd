"""The figures of one enhanced photograph, and the table of all: metrics.csv."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..capture.scaling import downscale_with_alpha
from ..color.simulation import Observer
from ..evaluate.scores import SIMULATED_FIGURES, Scorer
from ..runs.enhanced import FILE_COLUMN, OUTPUT_COLUMN

_METRIC_PIXELS = 1_000_000
"""Photographs with more pixels are measured on a copy reduced to so many, which takes half a gigabyte and some 5 s."""

FIGURES = (
    *(f"{figure}_{kind}" for figure in SIMULATED_FIGURES for kind in ("input", "enhanced")),
    "naturalness_ssim",
    "naturalness_psnr",
    "naturalness_delta_e_2000",
)
"""Columns of the metrics; see `core.color.metrics`. "input": of the photograph seen as it is."""

_COLUMNS = (FILE_COLUMN, OUTPUT_COLUMN, "width", "height", *FIGURES, "seconds", "metrics_scale", "notes")


@dataclass(frozen=True)
class PhotographScores:
    """A row of the table.

    Attributes:
        file, output: names of the photograph and of its result.
        width, height: of the result, in pixels.
        figures: by `FIGURES`; NaN where there is nothing to measure on, infinite PSNR where nothing changed.
        seconds: what the enhancer took, its fit included where it was fitted to this photograph alone.
        scale: of the copy on which the metrics were computed, relative to the result; 1 is full resolution.
        notes: remarks on the row.
    """

    file: str
    output: str
    width: int
    height: int
    figures: dict[str, float]
    seconds: float
    scale: float = 1.0
    notes: Sequence[str] = field(default_factory=tuple)


def figures_of(
    original: NDArray[np.uint8], enhanced: NDArray[np.uint8], alpha: NDArray[np.uint8] | None, observer: Observer
) -> tuple[dict[str, float], float]:
    """The figures of an (H, W, 3) pair over the pixels that are not fully transparent, and the scale they are for."""
    height, width = original.shape[:2]
    scale = min(math.sqrt(_METRIC_PIXELS / (height * width)), 1.0)
    if scale < 1.0:
        size = (max(round(width * scale), 1), max(round(height * scale), 1))
        original, reduced_alpha = downscale_with_alpha(original, alpha, *size)
        enhanced, alpha = downscale_with_alpha(enhanced, alpha, *size)[0], reduced_alpha
    scorer = Scorer(original, observer, None if alpha is None else alpha > 0)
    figures: dict[str, float] = {}
    for kind, image in (("input", original), ("enhanced", enhanced)):
        seen = scorer.simulated(image)
        figures |= {f"{figure}_{kind}": seen[figure] for figure in SIMULATED_FIGURES}
    natural = scorer.naturalness(enhanced)
    figures["naturalness_ssim"] = natural.ssim
    figures["naturalness_psnr"] = natural.psnr
    figures["naturalness_delta_e_2000"] = natural.delta_e_2000
    return figures, scale


def mean_scores(rows: Sequence[PhotographScores]) -> dict[str, float]:
    """Each figure's mean over the rows that have it; NaN where none has."""
    means = {}
    for name in FIGURES:
        finite = [row.figures[name] for row in rows if math.isfinite(row.figures[name])]
        means[name] = sum(finite) / len(finite) if finite else math.nan
    return means


def write_table(path: Path, rows: Sequence[PhotographScores]) -> None:
    """Write a row for each photograph and one for their mean; undefined figures are empty and ``notes`` says why."""
    # A file's name may hold bytes that are no UTF-8.
    with open(path, "w", newline="", encoding="utf-8", errors="backslashreplace") as file:
        writer = csv.DictWriter(file, _COLUMNS)
        writer.writeheader()
        for row in rows:
            writer.writerow(
                {
                    FILE_COLUMN: row.file,
                    OUTPUT_COLUMN: row.output,
                    "width": row.width,
                    "height": row.height,
                    **{name: _cell(value) for name, value in row.figures.items()},
                    "seconds": f"{row.seconds:.2f}",
                    "metrics_scale": f"{row.scale:.4g}",
                    "notes": "; ".join([*row.notes, *_reasons(row)]),
                }
            )
        mean = {name: _cell(value) for name, value in mean_scores(rows).items()}
        seconds = sum(row.seconds for row in rows) / len(rows)
        note = f"mean over {len(rows)} photographs; where a figure is undefined, over the others"
        writer.writerow({FILE_COLUMN: "mean", **mean, "seconds": f"{seconds:.2f}", "notes": note})


def _cell(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else ""


def _reasons(row: PhotographScores) -> list[str]:
    """Why figures of the row are empty."""
    undefined = [name for name in FIGURES if math.isnan(row.figures[name])]
    if "naturalness_delta_e_2000" in undefined:
        return ["no pixel is visible"]
    reasons = []
    if any("ssim" in name for name in undefined):
        reasons.append("SSIM: no complete window of 11 x 11 pixels")
    if any(name.startswith("cc") for name in undefined):
        reasons.append("CCPR and CCFR: no two colours are distinct")
    if math.isinf(row.figures["naturalness_psnr"]):
        reasons.append("PSNR: infinite, the photograph is unchanged")
    if row.scale < 1.0:
        reasons.append(f"metrics were computed on a copy reduced to {_METRIC_PIXELS / 1e6:g} megapixel")
    return reasons
