"""Speed against accuracy: what recipes of many lengths and sizes cost and give, and which of them nothing dominates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...events import Reporter
from ..enhancers.methods import GAIN, NETWORK, NONE
from .enhancers import PER_VIEW_LUT
from .front import pareto_front
from .jobs import Job, run_jobs
from .peers import PeerFigures
from .recipe import NOT_MEASURED, Recipe, Trial
from .subject import CaptureFolder

DEFAULT, PEER = "default", "peer"
SERIES = ("steps", "photographs", "limit", "SH degree", "mode", "enhancer")
"""What is varied; everything else is then the product's."""

_STEPS = (1 / 3, 2 / 3, 4 / 3, 8 / 3)  # of the base, at full size
_SMALLER = {2 / 3: (1, 2), 1 / 2: (0.5, 1, 2), 1 / 3: (1,)}  # size of the photographs: steps, of the base
_BASE_SIZE = 2 / 3
_LIMITS = (2500, 5000, 10_000, 20_000)
_DEGREES = (1, 3)
_ENHANCERS = (NONE, GAIN, NETWORK, PER_VIEW_LUT)
_DIGITS_OF_STEPS = 10  # steps are rounded to tens


@dataclass(frozen=True)
class Default:
    """One of the product's own choices.

    Attributes:
        name: as its users know it.
        iterations: of the geometry.
        max_size: longer side of the photographs.
    """

    name: str
    iterations: int
    max_size: int


@dataclass(frozen=True)
class Variant:
    """A recipe, the size of the photographs that it is given, and what it is varied in."""

    series: str
    recipe: Recipe
    fitted_size: int


@dataclass(frozen=True)
class ParetoPoint:
    """What a variant, or a peer, cost and gave. Figures are on held-out views at the judged size; NaN is not measured.

    Attributes:
        capture, series, label, mode, enhancer: what was tried.
        size: longer side of the photographs that were fitted.
        iterations, seed: of the geometry.
        gaussians, sh_degree: of the result.
        psnr: of the scene in the photographs' colours, dB.
        ccpr, rwe: of the enhanced scene.
        score: CCPR × (1 - RWE), and 0 where RWE > 1.
        geometry_seconds, seconds: wall time of the geometry, and of all that makes the enhanced scene.
        processor_seconds: of all that, and of all threads.
        peak_memory_mb: of the process.
        leads_psnr: no other point has more PSNR for no more `geometry_seconds`.
        leads_score: no other point has a higher score for no more `seconds`.
        error: why there are no figures; empty where there are.
    """

    capture: str
    series: str
    label: str
    mode: str
    enhancer: str
    size: int
    iterations: int
    seed: int
    gaussians: int
    sh_degree: int
    psnr: float
    ccpr: float
    rwe: float
    score: float
    geometry_seconds: float
    seconds: float
    processor_seconds: float
    peak_memory_mb: int
    leads_psnr: bool = False
    leads_score: bool = False
    error: str = ""

    @classmethod
    def of_trial(cls, variant: Variant, trial: Trial) -> ParetoPoint:
        """What a trial says of a variant."""
        return cls(
            capture=trial.capture,
            series=variant.series,
            label=trial.label,
            mode=trial.mode,
            enhancer=trial.enhancer,
            size=variant.fitted_size,
            iterations=trial.iterations,
            seed=trial.seed,
            gaussians=trial.gaussians,
            sh_degree=trial.sh_degree,
            psnr=trial.psnr,
            ccpr=trial.ccpr,
            rwe=trial.rwe,
            score=consistent_contrast(trial.ccpr, trial.rwe),
            geometry_seconds=trial.geometry_seconds,
            seconds=trial.seconds,
            processor_seconds=trial.processor_seconds,
            peak_memory_mb=trial.peak_memory_mb,
            error=trial.error,
        )

    @classmethod
    def of_peer(cls, capture: str, size: int, peer: PeerFigures) -> ParetoPoint:
        """What another program gave; it enhances nothing."""
        return cls(
            capture=capture,
            series=PEER,
            label=peer.label,
            mode="",
            enhancer="",
            size=size,
            iterations=peer.iterations,
            seed=0,
            gaussians=peer.gaussians,
            sh_degree=peer.sh_degree,
            psnr=peer.psnr,
            ccpr=NOT_MEASURED,
            rwe=NOT_MEASURED,
            score=NOT_MEASURED,
            geometry_seconds=peer.seconds,
            seconds=NOT_MEASURED,
            processor_seconds=peer.processor_seconds,
            peak_memory_mb=0,
        )


def consistent_contrast(ccpr: float, rwe: float) -> float:
    """CCPR × (1 - RWE). Where RWE > 1 more contrast would make it worse, which says nothing: it is 0 there."""
    return ccpr * max(1.0 - rwe, 0.0) if not math.isnan(rwe) else math.nan


def variants(size: int, base_steps: int, defaults: Sequence[Default], seed: int = 0) -> list[Variant]:
    """A part of the product of all choices: one varied at a time, around the base, and the product's defaults.

    Args:
        size: longer side of the photographs that results are judged by.
        base_steps: of the base, which has photographs of two thirds that size.
    """
    base_size = round(_BASE_SIZE * size)

    def variant(series: str, label: str, fitted_size: int = base_size, **choices) -> Variant:
        choices = {"iterations": base_steps, **choices}
        return Variant(series, Recipe(label, seed=seed, **choices), fitted_size)

    found = []
    for factor in _STEPS:
        steps = _rounded(factor * base_steps)
        found.append(variant("steps", f"{steps:,} steps", size, iterations=steps))
    for share, factors in _SMALLER.items():
        for factor in factors:
            steps, smaller = _rounded(factor * base_steps), round(share * size)
            found.append(variant("photographs", f"{steps:,} steps at {smaller} px", smaller, iterations=steps))
    found += [variant("limit", f"at most {limit:,} Gaussians", gaussians=limit) for limit in _LIMITS]
    found += [variant("SH degree", f"SH degree {degree}", sh_degree=degree) for degree in _DEGREES]
    found += [variant("mode", f"mode {mode}", mode=mode) for mode in ("joint", "post")]
    found += [variant("enhancer", f"enhancer {name}", enhancer=name) for name in _ENHANCERS]
    for default in defaults:
        fitted = min(default.max_size, size)
        found.append(variant(DEFAULT, default.name, fitted, iterations=default.iterations, sh_degree=None))
    return found


def few_variants(size: int, base_steps: int, defaults: Sequence[Default], seed: int = 0) -> list[Variant]:
    """Enough of `variants` to see that everything works; all at one size, so that they share a process."""
    base = Recipe("base", iterations=base_steps, seed=seed)
    found = [
        Variant("steps", replace(base, label="half the steps", iterations=base_steps // 2), size),
        Variant("steps", replace(base, label="a short run"), size),
        Variant("mode", replace(base, label="mode post", mode="post"), size),
        Variant("enhancer", replace(base, label=f"enhancer {NONE}", enhancer=NONE), size),
    ]
    return [*found, *(Variant(DEFAULT, replace(base, label=default.name), size) for default in defaults[:1])]


def measure_variants(
    source: CaptureFolder,
    tried: Sequence[Variant],
    folder: Path,
    reporter: Reporter,
    *,
    processes: int = 1,
    again: bool = False,
) -> list[ParetoPoint]:
    """Try all variants on a capture; those of the same photographs and seed share what they have in common."""
    groups = dict.fromkeys((variant.fitted_size, variant.recipe.seed) for variant in tried)
    order = [[v for v in tried if (v.fitted_size, v.recipe.seed) == group] for group in groups]
    jobs = [
        Job(replace(source, fitted_size=group[0].fitted_size), tuple(variant.recipe for variant in group))
        for group in order
    ]
    trials = run_jobs(jobs, folder, reporter, processes=processes, again=again)
    listed = [variant for group in order for variant in group]
    return [ParetoPoint.of_trial(variant, trial) for variant, trial in zip(listed, trials, strict=True)]


def with_fronts(points: Sequence[ParetoPoint]) -> list[ParetoPoint]:
    """The points of one capture with their `leads_psnr` and `leads_score`; by what the geometry costs, then."""
    psnr = set(pareto_front([p.geometry_seconds for p in points], [p.psnr for p in points]))
    score = set(pareto_front([p.seconds for p in points], [p.score for p in points]))
    marked = [replace(p, leads_psnr=i in psnr, leads_score=i in score) for i, p in enumerate(points)]
    return sorted(marked, key=lambda p: (math.isnan(p.geometry_seconds), p.geometry_seconds))


def _rounded(steps: float) -> int:
    return max(round(steps / _DIGITS_OF_STEPS) * _DIGITS_OF_STEPS, _DIGITS_OF_STEPS)
