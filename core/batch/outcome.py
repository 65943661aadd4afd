"""How a batch ended: what is said of it, and its exit code. Standard library only."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..job import Event
from ..job_console import EXIT_DONE
from ..progress import format_seconds
from .task import BATCH_FOLDER, Kind, Plan

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
        f"{tasks['kept']} were done before, {tasks['failed']} failed, {tasks['blocked']} could not be begun"
    ]
    lines += [f"  {failed['task']} failed: {failed['message']} (see {failed['log']})" for failed in result["failed"]]
    if result["failed"]:
        lines.append("  start the batch again to do what is missing")
    if result["page"]:
        lines.append(f"  open {result['page']}")
    return "\n".join(lines)


def log_path(task: str, out: Path) -> Path:
    """Where everything is written that the task of that name says, every attempt after the ones before."""
    return out / BATCH_FOLDER / "logs" / f"{task}.log"
