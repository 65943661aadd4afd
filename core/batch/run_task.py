"""Does one task of a plan, unless it is done: the one place where engines and kinds of work meet.

Standard library only; the module of a kind is imported when a task of that kind is run.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from ..job_console import Listener
from .task import Kind, Plan, Task

_Function = Callable[[Task, Path, Listener], None]

# The module of this package whose `run` does tasks of a kind.
_MODULES = {
    Kind.TRAIN: "train",
    Kind.LAYER: "layer",
    Kind.FRAMES: "frames",
    Kind.VIDEO: "video",
    Kind.SHEET: "contact_sheet",
    Kind.PAGE: "page",
}


def run_task(plan: Plan, name: str, listen: Listener) -> None:
    """Do the task called `name` if it is not done.

    Args:
        listen: receives every event.

    Raises:
        InputError: there is no such task, or its input is unusable.
        WorkerDefect: a worker failed, or the outputs are not there afterwards.
        Cancelled: nothing half-written was left.
    """
    task = plan.task(name)
    _function(task.kind)(task, plan.out, listen)


def _function(kind: Kind) -> _Function:
    return importlib.import_module(f".{_MODULES[kind]}", __package__).run
