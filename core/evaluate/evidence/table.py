"""The main table: modes and enhancers side by side on several captures, with controls, over several seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...settings import MODES
from ..enhancers.methods import GAIN, LUT, NETWORK, NONE
from ..tables import markdown_table, number, write_csv
from .enhancers import PER_VIEW_LUT
from .jobs import Job
from .recipe import Recipe, Trial
from .subject import SubjectSource
from .summary import Summary, cell, failures, seeds_of

BASELINE = "post"
DRIFT = 15.0
"""Degrees by which hues turn from view to view, as a standard deviation, where an enhancer drifts in a known amount."""
RWE_TO_REACH = 0.25
"""Of `layers`, relative to `post`; the seed reports 0.38."""
CCPR_TO_KEEP = 0.003
"""How far `layers` may be below `post`; the seed reports the same."""


@dataclass(frozen=True)
class Row:
    """One enhancer of the table.

    Attributes:
        name: starts the labels of its recipes.
        title: what the table calls it.
        enhancer, drift: as in `Recipe`.
        modes: that it is tried in.
        contradicts: whether it contradicts itself from view to view.
    """

    name: str
    title: str
    enhancer: str
    modes: tuple[str, ...] = (BASELINE, "joint", "layers")
    drift: float = 0.0
    contradicts: bool = False

    def label(self, mode: str) -> str:
        """Of its recipe in this mode."""
        return f"{self.name}-{mode}"


ROWS = (
    Row("none", "none", NONE, ("layers",)),
    Row("gain", "contrast gain", GAIN, ("layers",)),
    Row("lut", "scene LUT", LUT),
    Row("network", "network", NETWORK),
    Row("lut-per-view", "LUT of each view", PER_VIEW_LUT, contradicts=True),
    Row("lut-drifting", "scene LUT, drifting", LUT, drift=DRIFT, contradicts=True),
)
QUICK_ROWS = tuple(row for row in ROWS if row.name in ("none", "lut-drifting"))

assert {mode for row in ROWS for mode in row.modes} == set(MODES)


def table_jobs(sources: Sequence[SubjectSource], iterations: int, seeds: int, rows: Sequence[Row] = ROWS) -> list[Job]:
    """A job a capture, so that enhanced views are made once for all seeds."""
    return [
        Job(
            source,
            tuple(
                Recipe(row.label(mode), mode, row.enhancer, iterations=iterations, seed=seed, drift=row.drift)
                for seed in range(seeds)
                for row in rows
                for mode in row.modes
            ),
        )
        for source in sources
    ]


@dataclass(frozen=True)
class Comparison:
    """A mode beside the baseline on one capture, with one enhancer, over seeds.

    Attributes:
        rwe: relative to the baseline's.
        added: the same of what enhancement added to the warping error of the scene in original colours; resampling of
            fine texture, which no mode can remove, is left out. NaN where the baseline adds nothing.
        ccpr: difference to the baseline's.
    """

    rwe: Summary
    added: Summary
    ccpr: Summary


def compare(trials: Sequence[Trial], baseline: Sequence[Trial]) -> Comparison:
    """Trials of a mode with those of the baseline of the same capture and enhancer, seed by seed."""
    pairs = list(zip(trials, baseline, strict=True))
    return Comparison(
        rwe=Summary.of(trial.rwe / base.rwe for trial, base in pairs),
        added=Summary.of(_added(trial, base) for trial, base in pairs),
        ccpr=Summary.of(trial.ccpr - base.ccpr for trial, base in pairs),
    )


def _added(trial: Trial, base: Trial) -> float:
    """Both over the baseline's floor, since `joint` has a geometry of its own."""
    excess = base.rwe - base.rwe_unenhanced
    return (trial.rwe - base.rwe_unenhanced) / excess if excess > 0.0 else math.nan


def write_table(
    folder: Path, trials: Sequence[Trial], synthetic: Sequence[str], heading: Sequence[str], rows: Sequence[Row] = ROWS
) -> list[str]:
    """Write ``table.csv``, a line a trial; returns the lines of the text.

    Args:
        synthetic: names of the captures that the figures to reach are for.
        heading: lines that say how the trials were made.
    """
    write_csv(folder / "table.csv", Trial, trials)
    lines = ["# Modes and enhancers", "", *heading, "", *_DEFINITIONS, ""]
    for capture in dict.fromkeys(trial.capture for trial in trials):
        lines += [f"## {capture}", "", *_capture_table([t for t in trials if t.capture == capture], capture, rows), ""]
    lines += ["## Against `post`", "", *_against_baseline(trials, rows), ""]
    lines += _figures_to_reach(trials, synthetic, rows)
    failed = failures(trials)
    return [*lines, *(["", "## What failed", "", *failed] if failed else [])]


_DEFINITIONS = [
    "Means over the held-out views (every eighth), ± standard deviation over the seeds. Observer: deutan 1.0.",
    "",
    "- **CCPR**: share of the photograph's contrasts between neighbouring pixels (ΔE76 of 6 or more) that are as large "
    "in the picture as the observer sees it; **global**: between pixels anywhere.",
    "- **SSIM to simulated**: of the photograph to the picture as the observer sees it. **Natural**: SSIM and ΔE00 of "
    "the enhanced photograph to the photograph, for normal vision.",
    "- **RWE**: how much neighbouring views contradict each other at the points that both see, relative to the "
    "photographs. **7 apart**: the same of views that are seven apart. **/ σ**: each side in units of its own standard "
    "deviation. **L1**: absolute, per pixel and channel, values in [0, 1]. **Added**: RWE minus that of the scene in "
    "original colours, which is what reconstruction and resampling leave without any enhancement.",
    "- **PSNR**: of the scene in original colours to the held-out photographs; in mode `joint` the geometry was fitted "
    "to enhanced views. **Seconds**: of geometry, enhancement and layer, with others at work on the same machine. "
    "**MB**: the most that the process had, which made the other rows too.",
    "- **contrast gain**: plain contrast with the mean ΔE76 of the scene LUT. **LUT of each view** and **drifting** "
    f"contradict themselves from view to view: a LUT for each image alone, and hues turned by {DRIFT:g}° (standard "
    "deviation) in each image.",
]


def _capture_table(trials: Sequence[Trial], capture: str, rows: Sequence[Row]) -> list[str]:
    header = ["enhancer", "mode", "CCPR", "global", "SSIM to simulated", "natural SSIM", "ΔE00", "RWE", "added"]
    header += ["7 apart", "/ σ", "L1", "PSNR", "Gaussians", "seconds", "MB"]
    body = [_input_row(trials)]
    for row in rows:
        for mode in row.modes:
            body.append([row.title, mode, *_figures(seeds_of(trials, capture, row.label(mode)))])
    return markdown_table(header, body)


def _figures(trials: Sequence[Trial]) -> list[str]:
    columns: list[tuple[Callable[[Trial], float], int]] = [
        (lambda t: t.ccpr, 3),
        (lambda t: t.global_ccpr, 3),
        (lambda t: t.ssim_simulated, 3),
        (lambda t: t.natural_ssim, 3),
        (lambda t: t.delta_e, 2),
        (lambda t: t.rwe, 3),
        (lambda t: t.rwe - t.rwe_unenhanced, 3),
        (lambda t: t.rwe_long, 3),
        (lambda t: t.rwe_normalised, 3),
        (lambda t: t.rwe_absolute, 4),
        (lambda t: t.psnr, 2),
        (lambda t: t.gaussians or math.nan, 0),
        (lambda t: t.seconds, 1),
        (lambda t: t.peak_memory_mb or math.nan, 0),
    ]
    return [cell(trials, figure, digits) for figure, digits in columns]


def _input_row(trials: Sequence[Trial]) -> list[str]:
    """The photographs themselves, which every trial was measured against."""
    ccpr, spread = cell(trials[:1], lambda t: t.ccpr_input, 3), cell(trials[:1], lambda t: t.global_ccpr_input, 3)
    ssim = cell(trials[:1], lambda t: t.ssim_input, 3)
    return ["input (photographs)", "", ccpr, spread, ssim, "1.000", "0.00", "1.000", *["–"] * 8]


def _against_baseline(trials: Sequence[Trial], rows: Sequence[Row]) -> list[str]:
    header = ["capture", "enhancer", "mode", "RWE to post", "added, to post", "CCPR, difference"]
    body = []
    for capture in dict.fromkeys(trial.capture for trial in trials):
        for row in rows:
            for mode in (mode for mode in row.modes if mode != BASELINE and BASELINE in row.modes):
                found = _comparison(trials, capture, row, mode)
                body.append([capture, row.title, mode, found.rwe.text(3), found.added.text(3), found.ccpr.text(3)])
    return markdown_table(header, body)


def _comparison(trials: Sequence[Trial], capture: str, row: Row, mode: str) -> Comparison:
    return compare(*(seeds_of(trials, capture, row.label(one)) for one in (mode, BASELINE)))


def _figures_to_reach(trials: Sequence[Trial], synthetic: Sequence[str], rows: Sequence[Row]) -> list[str]:
    lines = ["## Figures to reach", ""]
    lines += [
        "On the synthetic showrooms, with an enhancer that contradicts itself: RWE of `layers` at most "
        f"{RWE_TO_REACH:g} of `post`'s, and CCPR no more than {CCPR_TO_KEEP:g} below it.",
        "",
    ]
    for capture in synthetic:
        for row in (row for row in rows if row.contradicts):
            found = _comparison(trials, capture, row, "layers")
            if math.isnan(found.rwe.mean):
                continue
            lines.append(
                f"- {capture}, {row.title}: RWE {number(found.rwe.mean, 3)} of `post`'s "
                f"({_verdict(found.rwe.mean <= RWE_TO_REACH)}), of what enhancement added "
                f"{number(found.added.mean, 3)} ({_verdict(found.added.mean <= RWE_TO_REACH)}); "
                f"CCPR {found.ccpr.mean:+.3f} ({_verdict(found.ccpr.mean >= -CCPR_TO_KEEP)})"
            )
    return lines


def _verdict(reached: bool) -> str:
    return "reached" if reached else "not reached"
