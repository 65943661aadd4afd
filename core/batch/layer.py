"""Tasks that see to it that a run has a layer. Standard library only."""

from __future__ import annotations

from pathlib import Path

from ..front import run as run_settings
from ..job_console import Listener, all_or_nothing
from ..run_files import LOG_FILE
from ..run_folder import RunFolder
from .arguments import LayerArguments
from .finished import check_finished_run
from .task import Task
from .train import settings_in


def run(task: Task, out: Path, listen: Listener) -> None:
    """Add the layer, unless the run was made with it.

    Raises:
        InputError: the run is damaged, or not that of these photographs.
        WorkerDefect: a worker failed.
    """
    arguments = LayerArguments.from_dict(task.arguments)
    settings = settings_in(out, {**arguments.settings})
    if arguments.source:
        listen({"event": "status", "stage": "start", "message": f"copying {arguments.source}"})
        _copy_run(out / arguments.source, Path(settings.out))
    if settings.layers[0].name not in check_finished_run(Path(settings.out)):
        run_settings(settings, listen)


def _copy_run(source: Path, target: Path) -> None:
    """Copy a finished run, whole or not at all, in place of one that was there."""
    check_finished_run(source)
    folder = RunFolder(target)
    with all_or_nothing(folder, str(target), LOG_FILE):
        folder.carry_over(source)
