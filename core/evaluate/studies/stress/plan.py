"""Which trials a stress test makes, and their results by method, axis and level."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from ....events import Reporter
from ..jobs import Job, pictures_of, run_jobs
from ..recipe import PLAIN, Recipe, Trial
from ..showroom_process import render_showroom
from ..subject import CaptureFolder, SubjectSource
from .axes import HARMLESS, Axis
from .subject import StressedCapture

# 40 views like the embedded demo's, but no larger than they are used.
_SHOWROOM = ("--samples", "16", "--depth-views", "2", "--seed", "0")


@dataclass(frozen=True)
class StressPlan:
    """What is tried.

    Attributes:
        base: the capture that is made worse; re-rendered axes make showrooms like the embedded one, so it is that.
        axes: what is varied.
        levels: of each axis, with `HARMLESS`.
        seeds: of training and of the mistakes.
        iterations: of the geometry.
        gaussians: limit of all methods, so that none has an advantage by size.
    """

    base: CaptureFolder
    axes: tuple[Axis, ...]
    levels: tuple[int, ...]
    seeds: tuple[int, ...]
    iterations: int = 300
    gaussians: int = 12_000

    @property
    def methods(self) -> tuple[Recipe, ...]:
        """Ours in its three modes, and settings of plain Gaussian splatting."""
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
        axis: None at the harmless level of the axes that share it: all that do not render the scene anew.
        source, recipe: what is tried.
    """

    method: str
    axis: Axis | None
    level: int
    seed: int
    source: SubjectSource
    recipe: Recipe


@dataclass(frozen=True)
class StressResult:
    """An attempt and what it gave.

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
        folder: for the rendered scenes, the trials and their pictures.
        processes: trials that run at a time.
        again: make all trials anew.

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


def _attempts(plan: StressPlan, scenes: dict[tuple[str, int], Path], seed: int) -> Iterator[Attempt]:
    methods = [replace(method, seed=seed) for method in plan.methods]
    for method in methods:
        yield Attempt(method.label, None, HARMLESS, seed, plan.base, method)
    for axis in plan.axes:
        # What is rendered anew is compared with what was rendered likewise.
        for level in plan.levels if axis.scene_option else plan.broken_levels:
            source: SubjectSource = plan.base
            if axis.disturb is not None:
                source = StressedCapture(plan.base, axis, level, seed)
            elif axis.scene_option:
                place = scenes[axis.name, level]
                source = CaptureFolder(place.name, place, plan.base.max_size)
            for method in methods:
                recipe = axis.recipe(method, level)
                # On shared captures only the label tells the attempts apart.
                is_shared = source is plan.base or level == HARMLESS
                label = f"{method.label}-{axis.name}-{level}" if is_shared else method.label
                yield Attempt(method.label, axis, level, seed, source, replace(recipe, label=label))


def _render_scenes(plan: StressPlan, folder: Path, reporter: Reporter) -> dict[tuple[str, int], Path]:
    width = plan.base.max_size
    usual = (*_SHOWROOM, "--width", str(width), "--height", str(width * 3 // 4))
    wanted = [(axis, level) for axis in plan.axes if axis.scene_option for level in plan.levels]
    scenes = {}
    for number, (axis, level) in enumerate(wanted):
        varied = () if level == HARMLESS else (axis.scene_option, f"{axis.value(level):g}")
        name = "untouched" if level == HARMLESS else f"{axis.name}-{axis.value(level):g}"
        place, arguments = folder / f"showroom-{name}-{width}", (*usual, *varied)
        scenes[axis.name, level] = render_showroom(
            place, arguments, reporter, done=number / len(wanted), share=1.0 / len(wanted)
        )
    return scenes
