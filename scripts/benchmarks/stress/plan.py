"""The trials of a stress test, by method, axis and level."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from ....core.runtime.protocol import Reporter
from ..studies.captures import CaptureFolder, SubjectSource, render_showrooms
from ..studies.jobs import Job, pictures_of, run_jobs
from ..studies.recipe import PLAIN, Recipe, Trial
from .axes import HARMLESS, Axis, PerturbedCapture

# 40 views like the embedded demo's, but rendered at the size at which they are used.
_SHOWROOM = ("--samples", "16", "--depth-views", "2", "--seed", "0")


@dataclass(frozen=True)
class StressPlan:
    """What to try.

    Attributes:
        base: the capture to perturb: the embedded one, since re-rendered axes make showrooms like it.
        axes: the conditions.
        levels: of each axis, with `HARMLESS`.
        seeds: of training and perturbations.
        iterations: of the geometry.
        gaussians: limit for all methods, so that none benefits from its size.
    """

    base: CaptureFolder
    axes: tuple[Axis, ...]
    levels: tuple[int, ...]
    seeds: tuple[int, ...]
    iterations: int = 300
    gaussians: int = 12_000

    @property
    def methods(self) -> tuple[Recipe, ...]:
        """Ours in its three modes, and plain Gaussian splatting."""
        usual = Recipe("layers", iterations=self.iterations, gaussians=self.gaussians)
        return (
            replace(usual, advised=True),
            replace(usual, label="joint", mode="joint"),
            replace(usual, label="post", mode="post"),
            replace(usual, label="plain", plans=PLAIN),
        )

    @property
    def broken_levels(self) -> tuple[int, ...]:
        """The levels above `HARMLESS`."""
        return tuple(level for level in self.levels if level != HARMLESS)


@dataclass(frozen=True)
class Attempt:
    """A method at a level of an axis with a seed.

    Attributes:
        axis: None at the harmless level that axes share, all but those that render the scene anew.
        source, recipe: the trial's.
    """

    method: str
    axis: Axis | None
    level: int
    seed: int
    source: SubjectSource
    recipe: Recipe


@dataclass(frozen=True)
class StressResult:
    """An attempt with its figures.

    Attributes:
        pictures: folder of its ``renders`` and ``enhanced``.
    """

    attempt: Attempt
    trial: Trial
    pictures: Path


def run_stress(
    plan: StressPlan, folder: Path, reporter: Reporter, *, processes: int = 1, again: bool = False
) -> list[StressResult]:
    """Make every trial that `folder` does not have yet.

    Args:
        folder: for rendered scenes, trials and their pictures.
        processes: number of parallel processes.
        again: repeat all trials.

    Raises:
        InputError: a scene could not be rendered.
    """
    scenes = _render_scenes(plan, folder / "scenes", reporter)
    attempts = [attempt for seed in plan.seeds for attempt in _attempts(plan, scenes, seed)]
    by_source: dict[tuple[str, int], list[Attempt]] = {}
    for attempt in attempts:
        by_source.setdefault((attempt.source.key, attempt.seed), []).append(attempt)
    jobs = [Job(group[0].source, tuple(attempt.recipe for attempt in group)) for group in by_source.values()]
    trials = run_jobs(jobs, folder, reporter, processes=processes, again=again)
    ordered = [attempt for group in by_source.values() for attempt in group]
    return [
        StressResult(attempt, trial, pictures_of(folder, attempt.source, attempt.recipe))
        for attempt, trial in zip(ordered, trials, strict=True)
    ]


def _attempts(plan: StressPlan, scenes: dict[tuple[str, int], CaptureFolder], seed: int) -> Iterator[Attempt]:
    methods = [replace(method, seed=seed) for method in plan.methods]
    for method in methods:
        yield Attempt(method.label, None, HARMLESS, seed, plan.base, method)
    for axis in plan.axes:
        # A scene that is rendered anew is compared with the untouched one rendered likewise.
        for level in plan.levels if axis.scene_option else plan.broken_levels:
            source: SubjectSource = plan.base
            if axis.perturb or axis.perturb_subject:
                source = PerturbedCapture(plan.base, axis, level, seed)
            elif axis.scene_option:
                source = scenes[axis.name, level]
            for method in methods:
                yield Attempt(method.label, axis, level, seed, source, axis.recipe(method, level))


def _render_scenes(plan: StressPlan, folder: Path, reporter: Reporter) -> dict[tuple[str, int], CaptureFolder]:
    width = plan.base.max_size
    usual = (*_SHOWROOM, "--width", str(width), "--height", str(width * 3 // 4))
    names: dict[tuple[str, int], str] = {}
    wanted: dict[str, tuple[str, ...]] = {}
    for axis in plan.axes:
        for level in plan.levels if axis.scene_option else ():
            varied = () if level == HARMLESS else (axis.scene_option, f"{axis.value(level):g}")
            what = f"{axis.name}-{varied[1]}" if varied else "untouched"
            names[axis.name, level] = name = f"showroom-{what}-{width}"
            wanted[name] = (*usual, *varied)
    places = render_showrooms(wanted, folder, reporter)
    return {key: CaptureFolder(name, places[name], width) for key, name in names.items()}
