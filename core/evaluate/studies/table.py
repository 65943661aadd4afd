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
"""Of `layers`, relative to `post`; Hu and Xiao (2026) report 0.38."""
CCPR_TO_KEEP = 0.003
"""How far `layers` may be below `post`; Hu and Xiao report the same."""


@dataclass(frozen=True)
class Row:
    """One enhancer of the table.

    Attributes:
        name: starts the labels of its recipes.
        title: what the table calls it.
        enhancer, drift: as in `Recipe`.
        modes: that it is tried in.
        contradicts: whether it contradicts itself from view to view.
        steady: name of the row with the same enhancer that does not, where there is one.
    """

    name: str
    title: str
    enhancer: str
    modes: tuple[str, ...] = (BASELINE, "joint", "layers")
    drift: float = 0.0
    contradicts: bool = False
    steady: str = ""

    def label(self, mode: str) -> str:
        """Of its recipe in this mode."""
        return f"{self.name}-{mode}"


ROWS = (
    Row("none", "none", NONE, ("layers",)),
    Row("gain", "contrast gain", GAIN, ("layers",)),
    Row("lut", "scene LUT", LUT),
    Row("network", "network", NETWORK),
    Row("lut-per-view", "LUT of each view", PER_VIEW_LUT, contradicts=True),
    Row("lut-drifting", "scene LUT, drifting", LUT, drift=DRIFT, contradicts=True, steady="lut"),
)
QUICK_ROWS = tuple(row for row in ROWS if row.name in ("none", "lut-drifting"))
_NAMED = {row.name: row for row in ROWS}

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
        drift: the same of what the enhancer's drift added to the warping error of the same enhancer without drift,
            which raises contrasts and their resampling errors alike; NaN where that was not tried.
        ccpr: difference to the baseline's.
    """

    rwe: Summary
    added: Summary
    drift: Summary
    ccpr: Summary


def compare(
    trials: Sequence[Trial], baseline: Sequence[Trial], steady: tuple[Sequence[Trial], Sequence[Trial]] = ((), ())
) -> Comparison:
    """Trials of a mode with those of the baseline of the same capture and enhancer, seed by seed.

    Args:
        steady: trials of the mode and of the baseline with the same enhancer without its drift.
    """
    pairs = list(zip(trials, baseline, strict=True))
    without = zip(*steady, strict=True)
    return Comparison(
        rwe=Summary.of(trial.rwe / base.rwe for trial, base in pairs),
        added=Summary.of(_added(trial, base) for trial, base in pairs),
        drift=Summary.of(
            _share(trial.rwe - calm.rwe, base.rwe - calm_base.rwe)
            for (trial, base), (calm, calm_base) in zip(pairs, without, strict=False)
        ),
        ccpr=Summary.of(trial.ccpr - base.ccpr for trial, base in pairs),
    )


def _added(trial: Trial, base: Trial) -> float:
    """Both over the baseline's floor, since `joint` has a geometry of its own."""
    return _share(trial.rwe - base.rwe_unenhanced, base.rwe - base.rwe_unenhanced)


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else math.nan


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
        of_capture = [trial for trial in trials if trial.capture == capture]
        lines += [f"## {capture}", "", *_quality(of_capture, capture, rows), "", *_cost(of_capture, capture, rows), ""]
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
    "original colours, which is what reconstruction and resampling leave without any enhancement. Raised contrasts "
    "raise resampling errors too; **drift**, in the comparison with `post`, is RWE minus that of the same enhancer "
    "without drift.",
    "- **PSNR**: of the scene in original colours to the held-out photographs; in mode `joint` the geometry was fitted "
    "to enhanced views. **Seconds**: of geometry, enhancement and layer by the clock, with other trials at work on the "
    "same machine; **processor seconds**: the same, of all threads together. **MB**: the most "
    "that the process had, which made the other rows too.",
    "- **contrast gain**: plain contrast with the mean ΔE76 of the scene LUT. **LUT of each view** and **drifting** "
    f"contradict themselves from view to view: a LUT for each image alone, and hues turned by {DRIFT:g}° (standard "
    "deviation) in each image.",
]


_Column = tuple[str, Callable[[Trial], float], int]
_QUALITY: tuple[_Column, ...] = (
    ("CCPR", lambda trial: trial.ccpr, 3),
    ("global", lambda trial: trial.global_ccpr, 3),
    ("SSIM to simulated", lambda trial: trial.ssim_simulated, 3),
    ("natural SSIM", lambda trial: trial.natural_ssim, 3),
    ("ΔE00", lambda trial: trial.delta_e, 2),
    ("RWE", lambda trial: trial.rwe, 3),
    ("added", lambda trial: trial.rwe - trial.rwe_unenhanced, 3),
    ("7 apart", lambda trial: trial.rwe_long, 3),
    ("/ σ", lambda trial: trial.rwe_normalised, 3),
    ("L1", lambda trial: trial.rwe_absolute, 4),
)
_COST: tuple[_Column, ...] = (
    ("PSNR", lambda trial: trial.psnr, 2),
    ("Gaussians", lambda trial: trial.gaussians or math.nan, 0),
    ("seconds", lambda trial: trial.seconds, 1),
    ("processor seconds", lambda trial: trial.processor_seconds, 1),
    ("MB", lambda trial: trial.peak_memory_mb or math.nan, 0),
)


def _quality(trials: Sequence[Trial], capture: str, rows: Sequence[Row]) -> list[str]:
    return _by_row(trials, capture, rows, _QUALITY, [_input_row(trials)])


def _cost(trials: Sequence[Trial], capture: str, rows: Sequence[Row]) -> list[str]:
    return _by_row(trials, capture, rows, _COST, [])


def _by_row(
    trials: Sequence[Trial], capture: str, rows: Sequence[Row], columns: Sequence[_Column], first: list[list[str]]
) -> list[str]:
    """A table with a row for each mode of each enhancer, behind the `first` ones."""
    body = list(first)
    for row in rows:
        for mode in row.modes:
            found = seeds_of(trials, capture, row.label(mode))
            body.append([row.title, mode, *(cell(found, figure, digits) for _, figure, digits in columns)])
    return markdown_table(["enhancer", "mode", *(name for name, _, _ in columns)], body)


def _input_row(trials: Sequence[Trial]) -> list[str]:
    """The photographs themselves, which every trial was measured against."""
    ccpr, spread = cell(trials[:1], lambda t: t.ccpr_input, 3), cell(trials[:1], lambda t: t.global_ccpr_input, 3)
    ssim = cell(trials[:1], lambda t: t.ssim_input, 3)
    return ["input (photographs)", "", ccpr, spread, ssim, "1.000", "0.00", "1.000", *["–"] * 4]


def _against_baseline(trials: Sequence[Trial], rows: Sequence[Row]) -> list[str]:
    header = ["capture", "enhancer", "mode", "RWE to post", "added, to post", "drift, to post", "CCPR, difference"]
    body = []
    for capture in dict.fromkeys(trial.capture for trial in trials):
        for row in rows:
            for mode in (mode for mode in row.modes if mode != BASELINE and BASELINE in row.modes):
                found = _comparison(trials, capture, row, mode)
                figures = (found.rwe, found.added, found.drift, found.ccpr)
                body.append([capture, row.title, mode, *(figure.text(3) for figure in figures)])
    return markdown_table(header, body)


def _comparison(trials: Sequence[Trial], capture: str, row: Row, mode: str) -> Comparison:
    def both(of: Row) -> tuple[list[Trial], list[Trial]]:
        return seeds_of(trials, capture, of.label(mode)), seeds_of(trials, capture, of.label(BASELINE))

    return compare(*both(row), both(_NAMED[row.steady]) if row.steady else ((), ()))


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
                f"{number(found.added.mean, 3)} ({_verdict(found.added.mean <= RWE_TO_REACH)})"
                f"{_of_drift(found)}; "
                f"CCPR {found.ccpr.mean:+.3f} ({_verdict(found.ccpr.mean >= -CCPR_TO_KEEP)})"
            )
    return lines


def _of_drift(found: Comparison) -> str:
    share = found.drift.mean
    return "" if math.isnan(share) else f", of what drift added {share:.3f} ({_verdict(share <= RWE_TO_REACH)})"


def _verdict(reached: bool) -> str:
    return "reached" if reached else "not reached"
