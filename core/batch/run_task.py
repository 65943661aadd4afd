"""Does one task of a plan, unless it is done: the one place where engines and kinds of work meet.

Standard library only; the module of a kind is imported when a task of that kind is run.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from ..job_console import Listener, WorkerDefect
from ..run_folder import lock_exclusively, open_lock
from .done import forget, is_done, sign_inputs, write_record
from .task import BATCH_FOLDER, Kind, Plan, Task

LOCK_FOLDER = "locks"
_LOCK_POLL_SECONDS = 0.5

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


def run_task(plan: Plan, name: str, listen: Listener) -> bool:
    """Do the task called `name` if it is not done; returns whether there was anything to do.

    Two processes that are given the same task do not get into each other's way: the second waits for the first.

    Args:
        listen: receives every event.

    Raises:
        InputError: there is no such task, or its input is unusable.
        WorkerDefect: a worker failed, or the outputs are not there afterwards.
        Cancelled: nothing half-written was left.
    """
    task = plan.task(name)
    with _alone(task, plan.out, listen):
        if is_done(task, plan.out):
            listen({"event": "status", "stage": str(task.kind), "message": f"{task.name} is done already"})
            return False
        listen({"event": "status", "stage": str(task.kind), "message": task.name})
        forget(task, plan.out)
        inputs = sign_inputs(task, plan.out)
        started = time.monotonic()
        _function(task.kind)(task, plan.out, listen)
        try:
            write_record(task, plan.out, inputs, time.monotonic() - started)
        except FileNotFoundError as error:
            raise WorkerDefect(f"{task.name} left no {error.filename}") from None
    return True


def _function(kind: Kind) -> _Function:
    return importlib.import_module(f".{_MODULES[kind]}", __package__).run


@contextlib.contextmanager
def _alone(task: Task, out: Path, listen: Listener) -> Iterator[None]:
    """Hold the lock of `task`, which vanishes with this process."""
    path = out / BATCH_FOLDER / LOCK_FOLDER / task.name
    path.parent.mkdir(parents=True, exist_ok=True)
    with open_lock(path) as lock:
        told = False
        while True:
            try:
                lock_exclusively(lock)
                break
            except OSError:
                if not told:
                    message = f"another process does {task.name}; waiting for it"
                    listen({"event": "status", "stage": str(task.kind), "message": message})
                    told = True
                time.sleep(_LOCK_POLL_SECONDS)
        yield
