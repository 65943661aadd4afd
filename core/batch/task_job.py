"""A task as a process of its own, for whoever starts it and listens. Standard library only."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from ..job import GRACE_SECONDS, Job
from .outcome import log_path
from .task import task_command

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
    log = TaskLog(name, plan_file.absolute().parent.parent)
    if note:
        log(note)
    command = [*task_command(sys.executable, plan_file, name), "--parent", str(os.getpid())]
    return Job(command, log=log, variables=variables, grace_seconds=_GRACE_SECONDS)


class TaskLog:
    """Adds lines to the log of the task called `name`, beside those that its process writes."""

    def __init__(self, name: str, out: Path) -> None:
        self._path = log_path(name, out)

    def __call__(self, line: str) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with open(self._path, "a", encoding="utf-8") as file:
            file.write(f"          {line}\n")
