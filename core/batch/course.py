"""The course of a batch, whichever engine does its tasks: which may begin, how they end, and what is said of it.

Standard library only.
"""

from __future__ import annotations

import time
from bisect import insort
from collections.abc import Iterator

from ..job_console import Listener
from .done import is_done
from .estimates import measured_pace
from .machine import Resources
from .outcome import BatchOutcome, State, TaskOutcome
from .progress import BatchProgress
from .task import Plan, Task

STAGE = "batch"
TELL_SECONDS = 1.0
"""Between events of progress."""


class Course:
    """Follows the tasks of `plan` from start to end.

    What is done already is left alone. A task that fails is tried again as often as the plan says; what needs it is
    given up then, and everything else goes on.

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
        self._told = 0.0
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
        """A task that was ready waits for its turn elsewhere; `hear` notices when that has come."""
        self._ready.remove(self._order[task.name])

    def hear(self, task: Task, event: dict) -> None:
        """A task has said something."""
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

    def tell(self) -> None:
        """Say how far the batch is, if that was not said just now."""
        now = time.monotonic()
        if now - self._told < TELL_SECONDS:
            return
        self._told = now
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
        """A task has come to its end, and with it those that can only be given up."""
        ended = [(task, outcome)]
        while ended:
            task, outcome = ended.pop()
            self._outcomes[task.name] = outcome
            self._progress.finish(task, outcome.seconds if outcome.state is State.DONE else None)
            self._tell_end(task, outcome)
            for dependent in self._dependents[task.name]:
                if dependent.name in self._outcomes:
                    continue
                waits_for = self._waits_for[dependent.name]
                waits_for.discard(task.name)
                if not outcome.state.is_good and not dependent.kind.tolerates_failures:
                    ended.append((dependent, TaskOutcome(State.BLOCKED, message=f"{task.name} has failed")))
                elif not waits_for:
                    self._make_ready(dependent)

    def _tell_end(self, task: Task, outcome: TaskOutcome) -> None:
        fields = {"task": task.name, "item": task.item, "state": str(outcome.state)}
        self._listen({"event": "task", **fields, "seconds": round(outcome.seconds, 2), "message": outcome.message})
        if outcome.state is State.FAILED:
            text = f"{task.name} failed: {outcome.message}"
            self._listen({"event": "warning", "name": "task-failed", "task": task.name, "message": text})
