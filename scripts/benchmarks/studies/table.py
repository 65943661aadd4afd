"""The main tables: modes and enhancers on several captures over several seeds, with controls; types and severities.

Command: ``benchmark.py table``, which also measures hard and easy frames (see `protocol`).
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ....core.runtime.cli import ConsoleReporter
from ....core.settings import CVD_TYPES, MODES, Layer
from ..enhancers.methods import GAIN, LUT, NETWORK, NONE, PER_VIEW_LUT, SCENE
from ..options import Part, add_study_arguments, chosen_sources, made_by, with_quick_defaults, work_folder
from ..provenance import predicting_weights, trained_product
from ..tables import Column, frame_of, means_and_deviations, tables_of_means, write_csv, write_text
from .captures import SHOWROOMS, SubjectSource
from .jobs import Job, run_jobs
from .protocol import ENHANCERS, PAPERS_RULE, filter_frames, scenes_of, sequences_of, summarise, write_frames
from .recipe import DEUTAN, Recipe, Trial, failures, optimistic, with_derived

SIZE, ITERATIONS, SEEDS = 240, 800, 3
BASELINE = "post"
DRIFT = 15.0
"""Degrees: standard deviation of the rotation of hues where an enhancer drifts from view to view by a known amount."""
RWE_TARGET = 0.25
"""Of `layers`, relative to `post`; Hu and Xiao (2026) report 0.38."""
CCPR_TOLERANCE = 0.003
"""How far `layers` may be below `post`; Hu and Xiao report the same."""
SEVERITIES = (0.4, 0.7, 1.0)
OBSERVERS = tuple(Layer(cvd, severity) for cvd in CVD_TYPES for severity in SEVERITIES)
QUICK_OBSERVERS = (Layer("deutan", 1.0), Layer("deutan", 0.4))


@dataclass(frozen=True)
class Row:
    """One enhancer of the main table.

    Attributes:
        name: begins the labels of its recipes.
        title: its name in the table.
        enhancer, drift: as in `Recipe`.
        modes: those to try.
        contradicts: whether the enhancer is inconsistent between views.
        steady: name of the row with the same enhancer without drift, if there is one.
    """

    name: str
    title: str
    enhancer: str
    modes: tuple[str, ...] = (BASELINE, "joint", "layers")
    drift: float = 0.0
    contradicts: bool = False
    steady: str = ""

    def label(self, mode: str) -> str:
        """The label of its recipe in a mode."""
        return f"{self.name}-{mode}"


ROWS = (
    Row("none", "none", NONE, ("layers",)),
    Row("gain", "contrast gain", GAIN, ("layers",)),
    Row("lut", "scene LUT", LUT, ("layers",)),
    Row("cgan", "predicted network", NETWORK, ("layers",)),
    Row("scene", "scene network", SCENE),
    Row("drifting", "scene network, drifting", SCENE, drift=DRIFT, contradicts=True, steady="scene"),
    Row("lut-per-view", "LUT of each view", PER_VIEW_LUT, (BASELINE, "layers"), contradicts=True),
)
QUICK_ROWS = tuple(row for row in ROWS if row.name in ("none", "drifting"))
_BY_LABEL = {row.label(mode): row for row in ROWS for mode in row.modes}

assert {mode for row in ROWS for mode in row.modes} == set(MODES)

_DEFINITIONS = [
    "Means over the held-out views (every eighth) and the seeds. Observer: deutan 1.0.",
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
    "to enhanced views. **Seconds**: of geometry, enhancement and layer by the clock{beside}; **processor seconds**: "
    "the same, of all threads together. **MB**: the most that the process had, which made the other rows too.",
    "- **contrast gain**: plain contrast with the mean ΔE76 of the scene network. **LUT of each view** and "
    "**drifting** contradict themselves from view to view: a LUT for each image alone, and hues turned by "
    f"{DRIFT:g}° (standard deviation) in each image.",
]
_KEYS: tuple[Column, ...] = (("title", "enhancer", ""), ("mode", "mode", ""))
_QUALITY: tuple[Column, ...] = (
    ("ccpr", "CCPR", ".3f"),
    ("global_ccpr", "global", ".3f"),
    ("ssim_simulated", "SSIM to simulated", ".3f"),
    ("natural_ssim", "natural SSIM", ".3f"),
    ("delta_e", "ΔE00", ".2f"),
    ("rwe", "RWE", ".3f"),
    ("added", "added", ".3f"),
    ("rwe_long", "7 apart", ".3f"),
    ("rwe_normalised", "/ σ", ".3f"),
    ("rwe_absolute", "L1", ".4f"),
)
_COST: tuple[Column, ...] = (
    ("psnr", "PSNR", ".2f"),
    ("gaussians", "Gaussians", ".0f"),
    ("seconds", "seconds", ".1f"),
    ("processor_seconds", "processor seconds", ".1f"),
    ("peak_memory_mb", "MB", ".0f"),
)
_AGAINST: tuple[Column, ...] = (
    ("rwe_ratio", "RWE to post", ".3f"),
    ("added_ratio", "added, to post", ".3f"),
    ("drift_ratio", "drift, to post", ".3f"),
    ("ccpr_difference", "CCPR, difference", ".3f"),
)
_SEVERITIES: tuple[Column, ...] = (
    ("cvd", "type", ""),
    ("severity", "severity", "g"),
    ("ccpr_input", "CCPR input", ".3f"),
    ("ccpr_enhanced", "enhanced", ".3f"),
    ("ccpr", "layer", ".3f"),
    ("global_ccpr_input", "global input", ".3f"),
    ("global_ccpr", "global layer", ".3f"),
    ("ssim_simulated", "SSIM to simulated", ".3f"),
    ("natural_ssim", "natural SSIM", ".3f"),
    ("delta_e", "ΔE00", ".2f"),
    ("rwe", "RWE", ".3f"),
    ("added", "added", ".3f"),
    ("further_seconds", "seconds per layer", ".1f"),
)


def table_jobs(sources: Sequence[SubjectSource], iterations: int, seeds: int, rows: Sequence[Row] = ROWS) -> list[Job]:
    """One job per capture, so that enhanced views are made once for all modes."""
    recipes = tuple(
        Recipe(row.label(mode), mode, row.enhancer, iterations=iterations, seed=seed, drift=row.drift)
        for seed in range(seeds)
        for row in rows
        for mode in row.modes
    )
    return [Job(source, recipes) for source in sources]


def severity_jobs(
    sources: Sequence[SubjectSource], iterations: int, seeds: int, observers: Sequence[Layer] = OBSERVERS
) -> list[Job]:
    """One job per capture: the default settings, for every observer."""
    recipes = tuple(
        Recipe(o.name, layer=o, iterations=iterations, seed=seed) for seed in range(seeds) for o in observers
    )
    return [Job(source, recipes) for source in sources]


def compare(trials: pd.DataFrame) -> pd.DataFrame:
    """Every trial beside the baseline's of the same capture, enhancer and seed.

    Args:
        trials: columns of `Trial`, and ``name``, that of the enhancer's `Row`.

    Returns:
        The trials of other modes with ``rwe_ratio``, ``added_ratio`` (of what enhancement adds to the RWE of the scene
        in original colours; resampling of fine texture, which no mode can remove, is left out), ``drift_ratio`` (of
        what drift adds to the RWE of the same enhancer without drift, which raises contrasts and their resampling
        errors alike) and ``ccpr_difference``. NaN where the baseline adds nothing or was not tried without drift.
    """
    keys = ["capture", "name", "mode", "seed"]
    steady = trials.assign(name=trials.name.map({row.name: row.steady for row in ROWS}))[keys]
    rwe_steady = steady.merge(trials[[*keys, "rwe"]], on=keys, how="left").rwe
    trials = trials.assign(rwe_steady=rwe_steady.to_numpy())
    others, base = trials[trials["mode"] != BASELINE], trials[trials["mode"] == BASELINE]
    found = others.merge(base, on=["capture", "name", "seed"], suffixes=("", "_base"))
    # Both over the baseline's floor, since `joint` has a geometry of its own.
    return found.assign(
        rwe_ratio=found.rwe / found.rwe_base,
        added_ratio=_share(found.rwe - found.rwe_unenhanced_base, found.rwe_base - found.rwe_unenhanced_base),
        drift_ratio=_share(found.rwe - found.rwe_steady, found.rwe_base - found.rwe_steady_base),
        ccpr_difference=found.ccpr - found.ccpr_base,
    )


def _share(part: pd.Series, whole: pd.Series) -> pd.Series:
    return (part / whole).where(whole > 0.0)


def write_table(
    folder: Path, trials: pd.DataFrame, synthetic: Sequence[str], heading: Sequence[str], *, processes: int = 1
) -> list[str]:
    """Write ``table.csv``, a line for each trial; returns the lines of the text.

    Args:
        trials: columns of `Trial`.
        synthetic: names of the captures that the targets are for.
        heading: lines that say how the trials were made.
        processes: how many ran at a time.
    """
    write_csv(folder / "table.csv", trials)
    trials = _titled(trials)
    beside = f", with up to {processes} trials at work on the same machine" if processes > 1 else ""
    definitions = [line.format(beside=beside) for line in _DEFINITIONS]
    lines = ["# Modes and enhancers", "", *heading, "", *definitions, "", *optimistic(trials)]
    for capture, mine in trials.groupby("capture", sort=False):
        means, deviations = means_and_deviations(mine, ["title", "mode"], (*_QUALITY, *_COST))
        quality = pd.concat([_photographs(mine), means])
        lines += [f"## {capture}", "", *tables_of_means(quality, deviations, _KEYS, _QUALITY), ""]
        lines += [*tables_of_means(means, deviations, _KEYS, _COST), ""]
    means, deviations = means_and_deviations(compare(trials), ["capture", "title", "mode"], _AGAINST)
    keys = (("capture", "capture", ""), *_KEYS)
    lines += [f"## Against `{BASELINE}`", "", *tables_of_means(means, deviations, keys, _AGAINST), ""]
    lines += _targets(means, synthetic)
    return [*lines, *failures(trials)]


def _titled(trials: pd.DataFrame) -> pd.DataFrame:
    """The trials with derived columns, and with ``name`` and ``title`` of their enhancers' rows."""
    rows = trials.label.map(_BY_LABEL)
    return with_derived(trials).assign(name=[row.name for row in rows], title=[row.title for row in rows])


def _photographs(trials: pd.DataFrame) -> pd.DataFrame:
    """The row of the photographs themselves, which every trial was compared with."""
    first = trials.iloc[0]
    figures = {"ccpr": first.ccpr_input, "global_ccpr": first.global_ccpr_input, "ssim_simulated": first.ssim_input}
    row = {"title": "input (photographs)", "mode": "", **figures, "natural_ssim": 1.0, "delta_e": 0.0, "rwe": 1.0}
    return pd.DataFrame([row])


def _targets(compared: pd.DataFrame, synthetic: Sequence[str]) -> list[str]:
    lines = ["## Figures to reach", ""]
    lines += [
        "On the synthetic showrooms, with an enhancer that contradicts itself: RWE of `layers` at most "
        f"{RWE_TARGET:g} of `{BASELINE}`'s, and CCPR no more than {CCPR_TOLERANCE:g} below it.",
        "",
    ]
    inconsistent = [row.title for row in ROWS if row.contradicts]
    chosen = (compared["mode"] == "layers") & compared.title.isin(inconsistent) & compared.capture.isin(synthetic)
    for found in compared[chosen & compared.rwe_ratio.notna()].itertuples():
        drift = found.drift_ratio
        of_drift = "" if math.isnan(drift) else f", of what drift added {drift:.3f} ({_verdict(drift <= RWE_TARGET)})"
        lines.append(
            f"- {found.capture}, {found.title}: RWE {found.rwe_ratio:.3f} of `{BASELINE}`'s "
            f"({_verdict(found.rwe_ratio <= RWE_TARGET)}), of what enhancement added "
            f"{found.added_ratio:.3f} ({_verdict(found.added_ratio <= RWE_TARGET)}){of_drift}; "
            f"CCPR {found.ccpr_difference:+.3f} ({_verdict(found.ccpr_difference >= -CCPR_TOLERANCE)})"
        )
    return lines


def _verdict(reached: bool) -> str:
    return "reached" if reached else "not reached"


def write_severities(folder: Path, trials: pd.DataFrame, heading: Sequence[str]) -> list[str]:
    """Write ``severities.csv``, a line for each trial; returns the lines of the text."""
    write_csv(folder / "severities.csv", trials)
    lines = ["# Types and severities", "", *heading, ""]
    lines += [
        "Mode `layers` with the product's scene network; all observers of a capture have one geometry a seed. Columns "
        "as in the main table; *input* is what the observer keeps of the photograph's contrast without any "
        "enhancement, *enhanced* what the enhanced photographs have, *layer* what the reconstructed scene has.",
        "",
        *optimistic(trials),
    ]
    trials = with_derived(trials)
    for capture, mine in trials.groupby("capture", sort=False):
        keys, figures = _SEVERITIES[:2], _SEVERITIES[2:]
        means, deviations = means_and_deviations(mine, [name for name, _, _ in keys], figures)
        lines += [f"## {capture}", "", *tables_of_means(means, deviations, keys, figures), ""]
    return [*lines, *failures(trials)]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, max_size=SIZE, iterations=ITERATIONS, seeds=SEEDS)
    what = "a Mip-NeRF 360 scene (images_4/ and sparse/0/) or a folder of such: hard frames, sequences, easy frames"
    parser.add_argument("--mipnerf360", type=Path, metavar="DIR", help=what)


def _measure(options: argparse.Namespace) -> str:
    """Compare modes and enhancers, then observers, then frames; writes .csv and .md of table, severities and frames."""
    options = with_quick_defaults(options)
    reporter, work = ConsoleReporter(sys.stderr), work_folder(options)
    rows, observers = (QUICK_ROWS, QUICK_OBSERVERS) if options.quick else (ROWS, OBSERVERS)
    sources = chosen_sources(options)
    synthetic = [source for source in sources if source.name in SHOWROOMS]
    scenes = scenes_of(options.mipnerf360, options.max_size) if options.mipnerf360 else []
    filtered = [] if options.quick else sources
    frames = {
        source: filter_frames(source, ENHANCERS, DEUTAN, work / "frames", reporter) for source in [*filtered, *scenes]
    }
    sequences = [run for scene in scenes for run in sequences_of(scene, next(iter(frames[scene].values())))]
    compared = table_jobs([*sources, *sequences], options.iterations, options.seeds, rows)
    observed = severity_jobs(synthetic or sources, options.iterations, options.seeds, observers)
    run_jobs([*compared, *observed], work, reporter, processes=options.processes, again=options.again)
    trials, seen = (
        frame_of(Trial, run_jobs(jobs, work, reporter, processes=options.processes)) for jobs in (compared, observed)
    )
    named = [source.name for source in synthetic]
    texts = {
        "table": write_table(options.out, trials, named, made_by(options, trials), processes=options.processes),
        "severities": write_severities(options.out, seen, made_by(options, seen)),
    }
    summaries = [
        summarise(source.name, enhancer, found) for source in frames for enhancer, found in frames[source].items()
    ]
    if summaries:
        texts["frames"] = write_frames(options.out, pd.DataFrame(summaries), _titled(trials), made_by(options))
    return "\n".join(write_text(options.out / f"{name}.md", lines) for name, lines in texts.items())


PART = Part(
    "table",
    "modes, enhancers and controls on several captures; types and severities",
    _add_arguments,
    _measure,
    pages=("table.md", "severities.md", "frames.md"),
    shaped_by=lambda: (
        *trained_product(),
        predicting_weights(),
        Recipe("any"),
        ROWS,
        OBSERVERS,
        ENHANCERS,
        PAPERS_RULE,
    ),
)
