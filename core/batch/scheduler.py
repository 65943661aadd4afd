"""Schedules a batch's tasks, whichever engine does them: which may start, how they end, and what is reported.

Standard library only.
"""

from __future__ import annotations

import time
from bisect import insort
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..runtime.process import Event
from ..runtime.progress import format_seconds
from ..runtime.resources import Resources
from ..runtime.supervisor import EXIT_DONE, Listener
from .progress import BatchProgress, measured_pace
from .records import is_done
from .task import BATCH_FOLDER, Kind, Plan, Task

STAGE = "batch"
PROGRESS_SECONDS = 1.0
"""Between events of progress."""


class BatchScheduler:
    """Follows the tasks of `plan` from start to end.

    Finished tasks are left alone. A task that fails is retried as often as the plan says; then the tasks that depend
    on it are given up, and everything else continues.

    Args:
        machine: all that the tasks may take at once, for the time left.
        listen: receives the batch's progress, a ``task`` event at every end of a task, and warnings.
    """

    def __init__(self, plan: Plan, machine: Resources, listen: Listener) -> None:
        self._plan, self._listen = plan, listen
        self._started = time.monotonic()
        self._progress = BatchProgress(plan, machine, measured_pace(plan.tasks, plan.out))
        self._order = {task.name: index for index, task in enumerate(plan.tasks)}
        self._waits_for = {task.name: set(task.after) for task in plan.tasks}
        self._dependents: dict[str, list[Task]] = {task.name: [] for task in plan.tasks}
        for task in plan.tasks:
            for before in task.after:
                self._dependents[before].append(task)
        self._ready: list[int] = []  # places in the plan
        self._checked: set[str] = set()
        self._failures: dict[str, int] = {}
        self._outcomes: dict[str, TaskOutcome] = {}
        self._reported = 0.0
        for task in plan.tasks:
            if not task.after:
                self._make_ready(task)

    @property
    def has_ended(self) -> bool:
        """Whether every task has."""
        return len(self._outcomes) == len(self._plan.tasks)

    @property
    def outcome(self) -> BatchOutcome:
        """How all tasks have ended."""
        return BatchOutcome(self._plan, self._outcomes, time.monotonic() - self._started)

    def ready(self) -> Iterator[Task]:
        """The tasks that may begin, in the plan's order; call `begin` for those that do, or `hand_out`."""
        position = 0
        while position < len(self._ready):
            place = self._ready[position]
            task = self._plan.tasks[place]
            if task.name not in self._checked:
                self._checked.add(task.name)
                if is_done(task, self._plan.out):
                    del self._ready[position]
                    self._end(task, TaskOutcome(State.KEPT))
                    position = 0  # others may have become ready
                    continue
            yield task
            if position < len(self._ready) and self._ready[position] == place:
                position += 1

    def begin(self, task: Task) -> None:
        """An attempt at a task that was ready begins."""
        self.hand_out(task)
        self._progress.start(task)

    def hand_out(self, task: Task) -> None:
        """A task that was ready is queued elsewhere; `handle_event` notices when it starts."""
        self._ready.remove(self._order[task.name])

    def handle_event(self, task: Task, event: dict) -> None:
        """Take in an event of a task."""
        if not self._progress.is_running(task):
            self._progress.start(task)
        if event["event"] == "warning":
            self._listen({**event, "message": f"{task.name}: {event['message']}"})
        else:
            self._progress.update(task, event)

    def succeed(self, task: Task, seconds: float, *, was_done: bool) -> None:
        """An attempt has ended well; `was_done` where there was nothing to do."""
        self._end(task, TaskOutcome(State.KEPT if was_done else State.DONE, seconds))

    def fail(self, task: Task, seconds: float, message: str, *, for_good: bool) -> None:
        """An attempt has failed; `for_good` where another one would fail in the same way."""
        failures = self._failures[task.name] = self._failures.get(task.name, 0) + 1
        if for_good or failures > self._plan.retries:
            self._end(task, TaskOutcome(State.FAILED, seconds, message))
            return
        self._progress.stop(task)
        text = f"{task.name} failed: {message}; trying again ({failures} of {self._plan.retries})"
        self._listen({"event": "warning", "name": "task-retried", "task": task.name, "message": text})
        self._make_ready(task)

    def report_progress(self) -> None:
        """Report the batch's progress, unless that was done within the last second."""
        now = time.monotonic()
        if now - self._reported < PROGRESS_SECONDS:
            return
        self._reported = now
        progress = self._progress
        self._listen(
            {
                "event": "progress",
                "stage": STAGE,
                "fraction": round(progress.fraction, 4),
                "seconds_left": round(progress.seconds_left, 1),
                "message": progress.message,
            }
        )

    def _make_ready(self, task: Task) -> None:
        insort(self._ready, self._order[task.name])

    def _end(self, task: Task, outcome: TaskOutcome) -> None:
        """A task has ended, and with it those that can only be given up."""
        ended = [(task, outcome)]
        while ended:
            task, outcome = ended.pop()
            self._outcomes[task.name] = outcome
            self._progress.finish(task, outcome.seconds if outcome.state is State.DONE else None)
            self._report_end(task, outcome)
            for dependent in self._dependents[task.name]:
                if dependent.name in self._outcomes:
                    continue
                waits_for = self._waits_for[dependent.name]
                waits_for.discard(task.name)
                if not outcome.state.is_good and not dependent.kind.tolerates_failures:
                    ended.append((dependent, TaskOutcome(State.BLOCKED, message=f"{task.name} has failed")))
                elif not waits_for:
                    self._make_ready(dependent)

    def _report_end(self, task: Task, outcome: TaskOutcome) -> None:
        fields = {"task": task.name, "item": task.item, "state": str(outcome.state)}
        self._listen({"event": "task", **fields, "seconds": round(outcome.seconds, 2), "message": outcome.message})
        if outcome.state is State.FAILED:
            text = f"{task.name} failed: {outcome.message}"
            self._listen({"event": "warning", "name": "task-failed", "task": task.name, "message": text})


EXIT_FAILED = 3
"""The batch has ended, and something in it has failed."""


class State(StrEnum):
    """How a task ended."""

    DONE = "done"
    KEPT = "kept"
    """It was done before, from the same inputs."""
    FAILED = "failed"
    BLOCKED = "blocked"
    """Something that it needs has failed."""

    @property
    def is_good(self) -> bool:
        """Whether what the task makes is there."""
        return self in (State.DONE, State.KEPT)


@dataclass(frozen=True)
class TaskOutcome:
    """How a task ended.

    Attributes:
        state: in one word.
        seconds: of the attempt that counts.
        message: what went wrong.
    """

    state: State
    seconds: float = 0.0
    message: str = ""


@dataclass(frozen=True)
class BatchOutcome:
    """How all of a plan's tasks ended.

    Attributes:
        plan: of the batch.
        tasks: by name.
        seconds: from the start of the batch to its end.
    """

    plan: Plan
    tasks: Mapping[str, TaskOutcome]
    seconds: float

    @property
    def exit_code(self) -> int:
        """Of the batch."""
        return EXIT_DONE if all(outcome.state.is_good for outcome in self.tasks.values()) else EXIT_FAILED

    def to_event(self) -> Event:
        """The fields of the batch's result, ready for JSON."""
        items = {task.item: True for task in self.plan.tasks if task.item}
        failed = []
        for task in self.plan.tasks:
            outcome = self.tasks[task.name]
            items[task.item] = items.get(task.item, True) and outcome.state.is_good
            if outcome.state is State.FAILED:
                log = log_path(task.name, self.plan.out)
                failed.append({"task": task.name, "item": task.item, "message": outcome.message, "log": str(log)})
        items.pop("", None)
        pages = [str(self.plan.out / task.outputs[0]) for task in self.plan.tasks if task.kind is Kind.PAGE]
        counts = Counter(outcome.state for outcome in self.tasks.values())
        return {
            "out": str(self.plan.out),
            "seconds": round(self.seconds, 2),
            "tasks": {str(state): counts[state] for state in State},
            "items": items,
            "failed": failed,
            "page": next((page for page in pages if self.tasks["page"].state.is_good), None),
        }


def summary(result: Mapping[str, Any]) -> str:
    """What a user reads of `BatchOutcome.to_event`."""
    items, tasks = result["items"], result["tasks"]
    finished = sum(items.values())
    lines = [
        f"{finished} of {len(items)} items in {format_seconds(result['seconds'])}: {tasks['done']} tasks done, "
        f"{tasks['kept']} done before, {tasks['failed']} failed, {tasks['blocked']} not started"
    ]
    lines += [f"  {failed['task']} failed: {failed['message']} (see {failed['log']})" for failed in result["failed"]]
    if result["failed"]:
        lines.append("  run the batch again to do what is missing")
    if result["page"]:
        lines.append(f"  open {result['page']}")
    return "\n".join(lines)


def log_path(task: str, out: Path) -> Path:
    """Where everything is written that the task of that name says, every attempt after the ones before."""
    return out / BATCH_FOLDER / "logs" / f"{task}.log"
