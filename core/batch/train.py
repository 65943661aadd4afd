"""Tasks that make a run: from photographs to Gaussians and their layers. Standard library only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..front import run as run_settings
from ..job_console import Listener
from ..settings import Settings
from .arguments import TrainArguments
from .task import Task


def run(task: Task, out: Path, listen: Listener) -> None:
    """Make the run; what an earlier one left in its folder is replaced when this one succeeds.

    Raises:
        InputError: unusable photographs or options, or the folder cannot be written.
        WorkerDefect: a worker failed.
    """
    arguments = TrainArguments.from_dict(task.arguments)
    run_settings(settings_in(out, {**arguments.settings, "layers": arguments.layers}), listen)


def settings_in(out: Path, values: dict[str, Any]) -> Settings:
    """The settings of a run whose paths are relative to `out` where they are not absolute."""
    return Settings.from_dict({**values, "out": str(out / values["out"]), "capture": str(out / values["capture"])})
