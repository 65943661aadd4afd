"""How many Gaussians a scene needs, and how many the automatic decision takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...events import Reporter
from .jobs import Job, run_jobs
from .knee import ALLOWED, TOLERANCE, find_knee, quality_at
from .recipe import Recipe, Trial
from .subject import CaptureFolder

AUTO = "auto"
HALF_DOUBLINGS = (-4, -2, -1, 0, 1, 2, 4)
"""Fixed numbers of Gaussians: half doublings from what the automatic decision took, a quarter of it to four times;
closer where the knee should be."""
FEW_HALF_DOUBLINGS = (-2, 0, 2)


@dataclass(frozen=True)
class BudgetRun:
    """One training; see `Trial` for the figures.

    Attributes:
        capture: what was trained.
        limit: most Gaussians that were asked for; 0: decided automatically.
        error: why there are no figures; empty where there are.
    """

    capture: str
    limit: int
    gaussians: int
    psnr: float
    ccpr: float
    rwe: float
    geometry_seconds: float
    processor_seconds: float
    peak_memory_mb: int
    decision: str
    error: str

    @classmethod
    def of_trial(cls, limit: int | None, trial: Trial) -> BudgetRun:
        """What a trial says of a limit."""
        return cls(
            capture=trial.capture,
            limit=limit or 0,
            gaussians=trial.gaussians,
            psnr=trial.psnr,
            ccpr=trial.ccpr,
            rwe=trial.rwe,
            geometry_seconds=trial.geometry_seconds,
            processor_seconds=trial.processor_seconds,
            peak_memory_mb=trial.peak_memory_mb,
            decision=trial.decision,
            error=trial.error,
        )


@dataclass(frozen=True)
class Verdict:
    """Whether the automatic decision was right about a capture.

    Attributes:
        capture: what was trained.
        plateau, knee: see `Knee`; of the runs with fixed numbers.
        gaussians, psnr: of the automatic run.
        half, twice: PSNR that half and twice its Gaussians give, interpolated between the fixed runs.
        decision: what the automatic run said.
    """

    capture: str
    plateau: float
    knee: float
    gaussians: int
    psnr: float
    half: float
    twice: float
    decision: str

    @property
    def behind(self) -> float:
        """dB that the automatic run lacks to the plateau."""
        return self.plateau - self.psnr

    @property
    def times_knee(self) -> float:
        """Its Gaussians relative to the knee's."""
        return self.gaussians / self.knee

    @property
    def reaches_plateau(self) -> bool:
        """Whether its quality is that of the plateau."""
        return self.behind <= TOLERANCE

    @property
    def is_lean(self) -> bool:
        """Whether it takes no more Gaussians than allowed."""
        return self.times_knee <= ALLOWED


def measure_budgets(
    sources: Sequence[CaptureFolder],
    iterations: int,
    half_doublings: Sequence[int],
    folder: Path,
    reporter: Reporter,
    *,
    processes: int = 1,
    again: bool = False,
    seed: int = 0,
) -> list[BudgetRun]:
    """Train each capture automatically, and then with fixed numbers of Gaussians around what that took.

    Args:
        half_doublings: of the automatic run's number of Gaussians.
    """
    auto = Recipe(f"{AUTO}, {iterations} steps", iterations=iterations, seed=seed)
    jobs = [Job(source, (auto,)) for source in sources]
    decided = run_jobs(jobs, folder, reporter, processes=processes, again=again)
    runs = [BudgetRun.of_trial(None, trial) for trial in decided]
    jobs = []
    for source, trial in zip(sources, decided, strict=True):
        if not trial.error:
            limits = [round(trial.gaussians * 2.0 ** (number / 2.0)) for number in half_doublings]
            recipes = [_fixed(limit, iterations, seed) for limit in limits]
            # Trainings have only the enhancer in common, so they may as well be spread over the processes.
            chunks = [tuple(recipes[start::processes]) for start in range(processes)]
            jobs += [Job(source, chunk) for chunk in chunks if chunk]
    trials = run_jobs(jobs, folder, reporter, processes=processes)
    recipes = [recipe for job in jobs for recipe in job.recipes]
    runs += [BudgetRun.of_trial(recipe.gaussians, trial) for recipe, trial in zip(recipes, trials, strict=True)]
    return sorted(runs, key=lambda run: ([s.name for s in sources].index(run.capture), run.limit))


def judge(runs: Sequence[BudgetRun]) -> list[Verdict]:
    """A verdict for each capture that was trained automatically and with fixed numbers of Gaussians."""
    verdicts = []
    for capture in dict.fromkeys(run.capture for run in runs):
        made = [run for run in runs if run.capture == capture and not run.error]
        fixed = [run for run in made if run.limit]
        for auto in (run for run in made if not run.limit and fixed):
            knee = find_knee(fixed)
            verdicts.append(
                Verdict(
                    capture,
                    knee.plateau,
                    knee.gaussians,
                    auto.gaussians,
                    auto.psnr,
                    half=quality_at(fixed, auto.gaussians / 2.0),
                    twice=quality_at(fixed, auto.gaussians * 2.0),
                    decision=auto.decision,
                )
            )
    return verdicts


def _fixed(limit: int, iterations: int, seed: int) -> Recipe:
    return Recipe(f"{limit} Gaussians, {iterations} steps", iterations=iterations, gaussians=limit, seed=seed)
