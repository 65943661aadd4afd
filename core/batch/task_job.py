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

# A cancelled task first ends its own workers, each within its grace period.
_GRACE_SECONDS = 3.0 * GRACE_SECONDS


def start_task(plan_file: Path, name: str, variables: Mapping[str, str] = MappingProxyType({})) -> Job:
    """Start the process that does the task called `name`; it ends when this process does, however that ends.

    What it prints beside its events is added to the task's log.

    Args:
        plan_file: as `write_plan` wrote it.
        variables: environment variables of the process, beside this process's.

    Raises:
        InputError: it cannot be started.
    """
    command = [*task_command(sys.executable, plan_file, name), "--parent", str(os.getpid())]
    log = _AppendingLog(log_path(name, plan_file.absolute().parent.parent))
    return Job(command, log=log, variables=variables, grace_seconds=_GRACE_SECONDS)


class _AppendingLog:
    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, line: str) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with open(self._path, "a", encoding="utf-8") as file:
            file.write(f"          {line}\n")
