"""Every type of colour vision deficiency at several severities, on one geometry a capture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...settings import CVD_TYPES, Layer
from ..enhancers.methods import NETWORK
from ..tables import markdown_table, number, write_csv
from .jobs import Job
from .recipe import Recipe, Trial
from .subject import SubjectSource
from .summary import failures, seeds_of

SEVERITIES = (0.4, 0.7, 1.0)
OBSERVERS = tuple(Layer(cvd, severity) for cvd in CVD_TYPES for severity in SEVERITIES)


def severity_jobs(
    sources: Sequence[SubjectSource], iterations: int, observers: Sequence[Layer] = OBSERVERS
) -> list[Job]:
    """A job a capture: the default settings with the network as enhancer, for every observer."""
    return [
        Job(
            source,
            tuple(
                Recipe(observer.name, enhancer=NETWORK, layer=observer, iterations=iterations) for observer in observers
            ),
        )
        for source in sources
    ]


def write_severities(
    folder: Path, trials: Sequence[Trial], heading: Sequence[str], observers: Sequence[Layer] = OBSERVERS
) -> list[str]:
    """Write ``severities.csv``, a line a trial; returns the lines of the text."""
    write_csv(folder / "severities.csv", Trial, trials)
    lines = ["# Types and severities", "", *heading, "", *_DEFINITIONS, ""]
    for capture in dict.fromkeys(trial.capture for trial in trials):
        lines += [f"## {capture}", "", *_capture_table(trials, capture, observers), ""]
    failed = failures(trials)
    return [*lines, *(["## What failed", "", *failed, ""] if failed else [])]


_DEFINITIONS = [
    "Mode `layers` with the product's network; all observers of a capture have one geometry. Columns as in the main "
    "table; *input* is what the observer keeps of the photograph's contrast without any enhancement, *enhanced* what "
    "the enhanced photographs have, *layer* what the reconstructed scene has.",
]


def _capture_table(trials: Sequence[Trial], capture: str, observers: Sequence[Layer]) -> list[str]:
    header = ["type", "severity", "CCPR input", "enhanced", "layer", "global input", "global layer"]
    header += ["SSIM to simulated", "natural SSIM", "ΔE00", "RWE", "added", "seconds a layer"]
    body = []
    for observer in observers:
        for trial in seeds_of(trials, capture, observer.name):
            contrast = (trial.ccpr_input, trial.ccpr_enhanced, trial.ccpr, trial.global_ccpr_input, trial.global_ccpr)
            figures = [number(value, 3) for value in (*contrast, trial.ssim_simulated, trial.natural_ssim)]
            figures += [number(trial.delta_e, 2), number(trial.rwe, 3), number(trial.rwe - trial.rwe_unenhanced, 3)]
            figures.append(number(trial.enhance_seconds + trial.layer_seconds, 1))
            body.append([observer.cvd, f"{observer.severity:g}", *figures])
    return markdown_table(header, body)
