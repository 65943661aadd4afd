"""The process that does one task: its log, its events, its signals, its exit code. Standard library only."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TextIO

from ..errors import Cancelled, InputError, one_line
from ..runtime.devices import explain_fault
from ..runtime.process import GRACE_SECONDS, Event, Job, follow_parent
from ..runtime.progress import RunProgress
from ..runtime.resources import CARDS_VARIABLE
from ..runtime.supervisor import BarDisplay, JsonDisplay, Listener, Log, WorkerDefect, WorkerRefusal, in_console
from .run_task import run_task
from .scheduler import log_path
from .task import read_plan, task_command


def run_task_in_console(plan_file: Path, name: str, *, json_events: bool, parent: int | None = None) -> int:
    """Do the task called `name`; returns the exit code of the contract.

    Args:
        plan_file: as `write_plan` wrote it.
        json_events: write the events to stdout as JSON lines instead of a progress bar on stderr.
        parent: process that this one belongs to; when it is gone, however it ended, the task is cancelled.
    """
    if parent is not None:
        follow_parent(lambda: os.kill(os.getpid(), signal.SIGINT), parent)

    def work(listen: Listener) -> Event:
        plan = read_plan(plan_file)
        task = plan.task(name)
        # Before anything counts the cores; whoever set it knows better.
        os.environ.setdefault("OMP_NUM_THREADS", str(task.cores))
        if task.gpu == 0:  # what was planned without a card must not take one that is there
            os.environ[CARDS_VARIABLE] = ""
        with _opened_log(log_path(name, plan.out)) as file:
            file.write(f"--- {time.strftime('%Y-%m-%d %H:%M:%S')} {task.name}, process {os.getpid()}\n")
            log = Log(file, listen)
            try:
                return {"task": name, "done_already": not run_task(plan, name, log.event)}
            except (InputError, WorkerDefect, Cancelled) as error:
                with contextlib.suppress(OSError):
                    log.line(f"{type(error).__name__}: {error}")
                raise
            except Exception as error:
                with contextlib.suppress(OSError):  # that may be what has happened
                    log.line(traceback.format_exc())
                if explanation := explain_fault(error):
                    raise WorkerRefusal(one_line(explanation)) from None
                raise WorkerDefect(f"{type(error).__name__}: {error}".splitlines()[0]) from None

    return in_console(work, JsonDisplay(sys.stdout) if json_events else _bar(sys.stderr))


@contextlib.contextmanager
def _opened_log(path: Path) -> Iterator[TextIO]:
    """The log of a task, to add to; raises `InputError` where that cannot be done."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = open(path, "a", encoding="utf-8")  # noqa: SIM115  # this is one
    except OSError as error:
        remedy = "free space, check the permissions, or choose another folder with --out"
        raise InputError(f"cannot be written ({error.strerror})", where=path, remedy=remedy) from None
    try:
        yield file
    finally:
        with contextlib.suppress(OSError):  # of a full disk, which must not hide how the task has ended
            file.close()


def _bar(stream: TextIO) -> Listener:
    progress = RunProgress(("task",), expected={"task": 1.0})
    return BarDisplay(stream, "turntable.py", progress, lambda result: f"done: {result['task']}")


# A cancelled task first ends its own workers, which takes it `GRACE_SECONDS`. On a busy machine everything takes
# longer, and a task that is killed cannot end them.
_GRACE_SECONDS = 10.0 * GRACE_SECONDS


def start_task(
    plan_file: Path, name: str, variables: Mapping[str, str] = MappingProxyType({}), *, note: str = ""
) -> Job:
    """Start the process that does the task called `name`; it ends when this process does, however that ends.

    What it prints beside its events is added to the task's log.

    Args:
        plan_file: as `write_plan` wrote it.
        variables: environment variables of the process, beside this process's.
        note: for the task's log, about where it is done.

    Raises:
        InputError: it cannot be started.
    """
    path = log_path(name, plan_file.absolute().parent.parent)

    def log(line: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "a", encoding="utf-8") as file:
            file.write(f"          {line}\n")

    if note:
        log(note)
    command = [*task_command(sys.executable, plan_file, name), "--parent", str(os.getpid())]
    return Job(command, log=log, variables=variables, grace_seconds=_GRACE_SECONDS)
