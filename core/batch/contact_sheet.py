"""Tasks that make a contact sheet. Standard library only."""

from __future__ import annotations

from pathlib import Path

from ..job_console import Listener
from .pictures import make_pictures
from .task import Task


def run(task: Task, out: Path, listen: Listener) -> None:
    """Make the PNG.

    Raises:
        InputError: a picture is missing, or the sheet cannot be written.
        WorkerDefect: Blender failed.
        Cancelled: nothing half-written is left.
    """
    make_pictures("sheet", task.arguments, out, listen)
