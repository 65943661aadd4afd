"""How far a batch is, and how long it will still take. Standard library only."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..pipeline.launch import stages_of
from ..runtime.process import Event
from ..runtime.progress import RunProgress
from ..runtime.resources import Resources
from ..settings import Settings
from .records import read_record
from .task import Kind, Plan, Task


@dataclass
class _Running:
    task: Task
    started: float
    last: float = 0.0
    stages: RunProgress = field(init=False)

    def __post_init__(self) -> None:
        adds_layer = self.task.kind is Kind.LAYER
        self.stages = RunProgress(stages_of(Settings("capture", "out", blend=False, resume=adds_layer)))

    def update(self, event: Event) -> None:
        self.stages.update(event)
        if event.get("event") == "progress":
            self.last = min(max(float(event["fraction"]), 0.0), 1.0)

    @property
    def fraction(self) -> float:
        """Of the task: a run's stages follow one another, other tasks have one."""
        return self.stages.fraction if self.task.kind in (Kind.TRAIN, Kind.LAYER) else self.last


class BatchProgress:
    """Follows the tasks of a plan.

    Args:
        plan: all of them.
        machine: that they share; None: as much as those take that are being done.
        pace: what tasks of a kind took so far, relative to their estimates.
    """

    def __init__(self, plan: Plan, machine: Resources | None, pace: Mapping[Kind, float]) -> None:
        self._tasks = {task.name: task for task in plan.tasks}
        self._machine = machine
        self._earlier_pace = dict(pace)
        self._running: dict[str, _Running] = {}
        self._open = dict(self._tasks)
        self._done_seconds = 0.0  # as they were estimated
        self._taken: dict[Kind, float] = defaultdict(float)
        self._expected: dict[Kind, float] = defaultdict(float)

    def start(self, task: Task) -> None:
        """An attempt at `task` begins."""
        self._running[task.name] = _Running(task, time.monotonic())

    def is_running(self, task: Task) -> bool:
        """Whether an attempt at `task` is running."""
        return task.name in self._running

    def update(self, task: Task, event: Event) -> None:
        """Take in an event of `task`."""
        if task.name in self._running:
            self._running[task.name].update(event)

    def stop(self, task: Task) -> None:
        """An attempt at `task` has failed."""
        self._running.pop(task.name, None)

    def finish(self, task: Task, seconds: float | None) -> None:
        """`task` has ended after so many seconds; None: there was nothing to do, or it cannot be done."""
        self._running.pop(task.name, None)
        self._open.pop(task.name, None)
        if seconds is not None:
            self._done_seconds += self._seconds(task)
            self._taken[task.kind] += seconds
            self._expected[task.kind] += task.seconds

    @property
    def fraction(self) -> float:
        """Of the work that there was to do, in [0, 1]."""
        left = sum(self._left(task) for task in self._open.values())
        begun = sum(self._seconds(running.task) * running.fraction for running in self._running.values())
        total = self._done_seconds + begun + left
        return (self._done_seconds + begun) / total if total > 0.0 else 1.0

    @property
    def seconds_left(self) -> float:
        """Estimate: all cores are busy with what is left, but no chain of tasks is done faster than one by one."""
        machine = self._machine or _taken_by(self._running.values())
        work, longest = 0.0, 0.0
        chain: dict[str, float] = {}
        for name, task in self._open.items():
            left = self._left(task)
            work += left * task.resources.capped(machine).cores
            chain[name] = left + max((chain.get(before, 0.0) for before in task.after), default=0.0)
            longest = max(longest, chain[name])
        return max(work / machine.cores, longest)

    @property
    def message(self) -> str:
        """What is being done, for people."""
        count = len(self._tasks) - len(self._open)
        names = ", ".join(self._running)
        return f"{count} of {len(self._tasks)} tasks" + (f"; {names}" if names else "")

    def _left(self, task: Task) -> float:
        running = self._running.get(task.name)
        return self._seconds(task) * (1.0 - (running.fraction if running else 0.0))

    def _seconds(self, task: Task) -> float:
        """Estimate for `task`, by what others of its kind took."""
        if self._expected[task.kind] > 0.0:
            return task.seconds * self._taken[task.kind] / self._expected[task.kind]
        return task.seconds * self._earlier_pace.get(task.kind, 1.0)


def _taken_by(running: Iterable[_Running]) -> Resources:
    cores = sum(one.task.cores for one in running)
    return Resources(max(cores, 1), memory_mb=0, gpus=0)


def estimated_seconds(plan: Plan, machine: Resources, pace: Mapping[Kind, float], done: set[str]) -> float:
    """How long the tasks of `plan` beside those called `done` will take on `machine`."""
    progress = BatchProgress(plan, machine, pace)
    for task in plan.tasks:
        if task.name in done:
            progress.finish(task, None)
    return progress.seconds_left


# The demo: 40 photographs of 480 x 360 (`make demo`).
_START_SECONDS = 16.0  # reading, enhancing, evaluating
_SECONDS_PER_ITERATION = 0.051
_LAYER_SECONDS = 20.0
LAYER_ADDED_SECONDS, LAYER_KEPT_SECONDS = _START_SECONDS + _LAYER_SECONDS, 1.0  # kept: the run was made with it
# 36,000 Gaussians in Cycles on one core; more cores share it.
_LOAD_SECONDS = 3.0
_SECONDS_PER_MEGAPIXEL = 170.0
_SIMULATION_SECONDS_PER_MEGAPIXEL = 0.3
_ENCODING_SECONDS_PER_MEGAPIXEL = 0.05
SHEET_SECONDS = 3.0
_PAGE_SECONDS_PER_ITEM = 0.5


def train_seconds(settings: Mapping[str, Any], layers: int) -> float:
    """Of a run with `settings` as `Settings` names them."""
    iterations = settings.get("iterations", Settings.iterations)
    return _START_SECONDS + _SECONDS_PER_ITERATION * iterations + _LAYER_SECONDS * layers


def frames_seconds(frames: int, size: tuple[int, int], observers: int, cores: int) -> float:
    """Of a chunk of `frames` pictures that so many observers see."""
    megapixels = size[0] * size[1] / 1e6
    each = _SECONDS_PER_MEGAPIXEL / cores + _SIMULATION_SECONDS_PER_MEGAPIXEL * observers
    return _LOAD_SECONDS + frames * megapixels * each


def video_seconds(frames: int, size: tuple[int, int], sequences: int) -> float:
    """Of a video of sequences side by side."""
    return 1.0 + frames * sequences * size[0] * size[1] / 1e6 * _ENCODING_SECONDS_PER_MEGAPIXEL


def page_seconds(items: int) -> float:
    """Of the page of so many items."""
    return 1.0 + _PAGE_SECONDS_PER_ITEM * items


def measured_pace(tasks: Iterable[Task], out: Path) -> dict[Kind, float]:
    """What tasks of a kind took, relative to their estimate, where the batch in `out` has done some of that kind."""
    taken: dict[Kind, float] = defaultdict(float)
    expected: dict[Kind, float] = defaultdict(float)
    for task in tasks:
        record = read_record(task, out)
        if record is not None and task.seconds > 0.0:
            taken[task.kind] += record.seconds
            expected[task.kind] += task.seconds
    return {kind: taken[kind] / expected[kind] for kind in taken}
