"""What a Dask worker does for a batch: the same command for a task as on one machine, in a process of its own."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from distributed import Worker, get_worker
from distributed.diagnostics.plugin import WorkerPlugin

from ... import __version__
from ..errors import Cancelled, InputError
from ..job import Event, Job
from ..job_console import Listener, WorkerDefect, finish
from .course import TELL_SECONDS
from .task_job import start_task


@dataclass(frozen=True)
class Attempt:
    """How an attempt at a task has ended.

    Attributes:
        seconds: that it took.
        complaint: what went wrong, in one line; "" for nothing.
        is_input: whether the input was unusable, and so will be the next time.
        was_done: whether there was nothing to do.
    """

    seconds: float
    complaint: str = ""
    is_input: bool = False
    was_done: bool = False


class TaskRunner(WorkerPlugin):
    """Does the tasks of one batch on a worker, and ends them when it is taken away.

    A worker that is killed cannot do that; its tasks notice by themselves that it is gone.

    Args:
        batch: name of the batch on this cluster, under which the worker keeps the runner and tells of its tasks.
    """

    def __init__(self, batch: str) -> None:
        self.name = batch

    def setup(self, worker: Worker) -> None:
        """The runner has reached its worker."""
        self._worker = worker
        self._lock = threading.Lock()
        self._jobs: set[Job] = set()
        self._cancelled = False

    async def teardown(self, worker: Worker) -> None:  # type: ignore[override]  # Dask awaits it
        """The batch has ended or was cancelled, or the worker closes."""
        with self._lock:
            self._cancelled = True
            jobs = list(self._jobs)
        await asyncio.gather(*(asyncio.to_thread(job.cancel) for job in jobs))

    def do(self, plan_file: str, task: str) -> Attempt:
        """Do a task, and tell of its events under the batch's name."""
        started = time.monotonic()
        complaint, is_input, was_done = "", False, False
        try:
            result = self._follow(plan_file, task)
            was_done = bool(result.get("done_already"))
        except (InputError, WorkerDefect) as error:
            complaint, is_input = str(error), isinstance(error, InputError)
        except Cancelled:
            complaint = "cancelled"
        return Attempt(time.monotonic() - started, complaint, is_input, was_done)

    def _follow(self, plan_file: str, task: str) -> Event:
        with self._lock:
            if self._cancelled:
                raise Cancelled
            job = start_task(Path(plan_file), task, note=f"for the Dask worker {self._worker.address}")
            self._jobs.add(job)
        try:
            listen = _Throttled(lambda event: self._worker.log_event(self.name, {"task": task, **event}))
            return finish(job, listen, patience_seconds=None)  # it may wait for another process that does the same
        finally:
            with self._lock:
                self._jobs.discard(job)


class _Throttled:
    """Passes on all events but progress that follows too soon: every one goes over the network to all who listen."""

    def __init__(self, listen: Listener) -> None:
        self._listen = listen
        self._last = -math.inf

    def __call__(self, event: Event) -> None:
        if event["event"] == "progress":
            now = time.monotonic()
            if now - self._last < TELL_SECONDS:
                return
            self._last = now
        self._listen(event)


def do_task(batch: str, plan_file: str, task: str) -> Attempt:
    """Do a task of a batch on the worker that this runs on."""
    runner = get_worker().plugins[batch]
    assert isinstance(runner, TaskRunner)
    return runner.do(plan_file, task)


def look_at_plan(plan_file: str) -> tuple[str, bytes | None]:
    """The version of cvdgs where this runs, and the plan as it is seen there; None where it is not."""
    try:
        return __version__, Path(plan_file).read_bytes()
    except OSError:
        return __version__, None
