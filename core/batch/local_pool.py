"""Does a plan on this machine: as many tasks at once as its cores, memory and graphics cards allow.

Every task is a process of its own with the command of `task_command`, the one that every other engine runs. What is
already done is left alone. A task that fails is tried again; what depends on it is given up, and everything else
continues. The processes end with this one, however it ends. Standard library only.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from ..errors import InputError
from ..runs.folder import is_held, lock_exclusively, open_lock
from ..runtime.process import Event, Job
from ..runtime.resources import CARDS_VARIABLE, Resources, card_names
from ..runtime.supervisor import EXIT_DONE, EXIT_INPUT, Listener
from .scheduler import PROGRESS_SECONDS, BatchOutcome, BatchScheduler
from .task import BATCH_FOLDER, Plan, Task, plan_path
from .task_process import start_task

_LOCK_FILE = "lock"
# A task that needs much of the machine lets small ones go first for so long; then it is its turn.
_PATIENCE_SECONDS = 120.0


def run_locally(plan: Plan, machine: Resources, listen: Listener) -> BatchOutcome:
    """Do the tasks of `plan`, whose file has been written.

    Args:
        machine: what the tasks may take at once.
        listen: receives the batch's progress, a ``task`` event at every end of a task, and warnings.

    Raises:
        InputError: a process cannot be started.
        Cancelled: all tasks were ended; what is done is kept.
    """
    return _Pool(plan, machine, listen).run()


@contextmanager
def alone(plan: Plan) -> Iterator[None]:
    """Keep other processes from working on the batch, which would do its tasks twice.

    Raises:
        InputError: one does, or files cannot be locked there.
    """
    path = plan.out / BATCH_FOLDER / _LOCK_FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    with open_lock(path) as lock:
        try:
            lock_exclusively(lock)
        except OSError as error:
            if not is_held(error):
                remedy = "choose another folder with --out"
                raise InputError(f"cannot be locked ({error.strerror})", where=path, remedy=remedy) from None
            remedy = "wait for it, or choose another folder with --out"
            raise InputError("another process is working on this batch", where=plan.out, remedy=remedy) from None
        yield


@dataclass
class _Attempt:
    """A process that does a task."""

    task: Task
    job: Job
    share: Resources
    cards: tuple[int, ...]
    started: float = field(default_factory=time.monotonic)
    complaint: str = ""
    was_done: bool = False
    code: int = 0


class _Pool:
    def __init__(self, plan: Plan, machine: Resources, listen: Listener) -> None:
        self._card_names = card_names(machine.gpus)
        machine = replace(machine, gpus=len(self._card_names))
        self._plan, self._machine, self._free = plan, machine, machine
        self._scheduler = BatchScheduler(plan, machine, listen)
        self._cards = list(range(machine.gpus))  # that are free, by their places among the names
        self._running: dict[str, _Attempt] = {}
        self._ready_since: dict[str, float] = {}
        self._events: queue.Queue[tuple[_Attempt, Event | None]] = queue.Queue()

    def run(self) -> BatchOutcome:
        try:
            self._start_what_fits()
            while not self._scheduler.has_ended:
                self._scheduler.report_progress()
                self._handle_next()
                self._start_what_fits()
            return self._scheduler.outcome
        except BaseException:
            self._cancel()
            raise

    def _start_what_fits(self) -> None:
        """Start ready tasks in the plan's order, later ones where an earlier one does not fit."""
        for task in self._scheduler.ready():
            since = self._ready_since.setdefault(task.name, time.monotonic())
            if self._free.covers(task.resources.capped(self._machine)):
                self._start(task)
            elif time.monotonic() - since > _PATIENCE_SECONDS:
                break
            if self._free.cores == 0:
                break

    def _start(self, task: Task) -> None:
        share = task.resources.capped(self._machine)
        cards = tuple(self._cards[: share.gpus])
        variables = _variables(share, [self._card_names[card] for card in cards])
        job = start_task(plan_path(self._plan.out), task.name, variables)
        attempt = self._running[task.name] = _Attempt(task, job, share, cards)
        self._free -= share
        self._cards = self._cards[share.gpus :]
        self._scheduler.begin(task)
        threading.Thread(target=self._listen_to, args=(attempt,), name=task.name, daemon=True).start()

    def _listen_to(self, attempt: _Attempt) -> None:
        for event in attempt.job.events():
            self._events.put((attempt, event))
        attempt.code = attempt.job.wait()
        self._events.put((attempt, None))

    def _handle_next(self) -> None:
        """Handle the next event of a task, if one arrives soon."""
        try:
            attempt, event = self._events.get(timeout=PROGRESS_SECONDS)
        except queue.Empty:
            return
        if event is None:
            self._take_back(attempt)
        elif event["event"] == "error":
            attempt.complaint = str(event["message"])
        elif event["event"] == "result":
            attempt.was_done = bool(event["done_already"])
        else:
            self._scheduler.handle_event(attempt.task, event)

    def _take_back(self, attempt: _Attempt) -> None:
        """A process has ended."""
        task, seconds = attempt.task, time.monotonic() - attempt.started
        del self._running[task.name]
        self._free += attempt.share
        self._cards = sorted([*self._cards, *attempt.cards])
        self._ready_since.pop(task.name, None)
        if attempt.code == EXIT_DONE:
            self._scheduler.succeed(task, seconds, was_done=attempt.was_done)
        else:
            message = attempt.complaint or _describe_end(attempt.code)
            # Unusable input is the same the next time.
            self._scheduler.fail(task, seconds, message, for_good=attempt.code == EXIT_INPUT)

    def _cancel(self) -> None:
        """End all processes, at the same time."""
        threads = [threading.Thread(target=attempt.job.cancel) for attempt in self._running.values()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


def _variables(share: Resources, cards: Sequence[str]) -> dict[str, str]:
    """Environment of a task's process: its part of the machine, and the Blender that this is."""
    variables = {"OMP_NUM_THREADS": str(share.cores)}
    if cards:
        variables[CARDS_VARIABLE] = ",".join(cards)
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.binary_path:
        variables["CVDGS_BLENDER"] = os.environ.get("CVDGS_BLENDER", bpy.app.binary_path)
    return variables


def _describe_end(code: int) -> str:
    return f"its process was ended by signal {-code}" if code < 0 else f"its process ended with exit code {code}"
