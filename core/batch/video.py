"""Tasks that make a video. Standard library only."""

from __future__ import annotations

from pathlib import Path

from ..job_console import Listener
from .pictures import make_pictures
from .task import Task


def run(task: Task, out: Path, listen: Listener) -> None:
    """Make the MP4.

    Raises:
        InputError: a picture is missing, or the video cannot be written.
        WorkerDefect: Blender failed.
        Cancelled: nothing half-written is left.
    """
    make_pictures("video", task.arguments, out, listen)
