"""Asks Blender for pictures, in a process of its own. Standard library only."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..job import PICTURE_WORKER, Event, Workers, blender_command
from ..job_console import Listener, finish


def to_stderr(line: str) -> None:
    """What Blender prints beside its events goes to stderr, and so to the task's log."""
    print(line, file=sys.stderr, flush=True)


def make_pictures(
    job: str,
    arguments: Mapping[str, Any],
    out: Path,
    listen: Listener,
    *,
    threads: int = 0,
    workers: Workers | None = None,
    log: Callable[[str], None] = to_stderr,
    **fields: Any,
) -> Event:
    """Let Blender do `job` with the task's `arguments` in the batch's folder `out`; returns the result.

    Args:
        job: see ``cvdgs_addon/batch/worker.py``.
        threads: that Blender takes; 0: as many as there are processors.
        workers: starts Blender, and may be cancelled.
        log: receives what Blender prints beside its events.
        fields: of the request, beside those.

    Raises:
        InputError: there is no Blender, or it refused the input.
        WorkerDefect: it failed.
        Cancelled: nothing half-written is left.
    """
    request = {"job": job, "out": str(out), "arguments": dict(arguments), "threads": threads, **fields}
    command = blender_command([], PICTURE_WORKER, threads)
    return finish((workers or Workers()).start_command(command, request, log), listen)
