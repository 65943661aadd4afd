"""Tasks that render pictures of a turntable. Standard library only."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..runs.report import report_or_nothing
from ..runtime.process import PICTURE_WORKER, Event, Workers, blender_command
from ..runtime.supervisor import Listener, WorkerDefect, finish
from ..settings import Settings
from .requests import FramesArguments

_CYCLES, _EEVEE = "cycles", "eevee"


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


def render(
    arguments: FramesArguments,
    out: Path,
    listen: Listener,
    *,
    threads: int,
    workers: Workers | None = None,
    log: Callable[[str], None] = to_stderr,
) -> None:
    """Render pictures of a turntable.

    Where there is no OpenGL, Cycles takes EEVEE's place, and `listen` receives a warning.

    Args:
        out: folder that the arguments' paths start from.
        threads: of the renderer; 0: as many as the processor has.
        workers, log: see `make_pictures`.

    Raises:
        InputError: the run, the layer or the engine cannot be used.
        WorkerDefect: Blender failed.
        Cancelled: no picture is half-written.
    """
    if arguments.engine == _EEVEE and not _has_eevee(out, listen, workers, log):
        arguments = replace(arguments, engine=_CYCLES)
        message = "EEVEE needs OpenGL, which this machine does not have; the pictures are rendered by Cycles"
        listen({"event": "warning", "name": "no-eevee", "message": message})
    result = make_pictures("frames", arguments.to_dict(), out, listen, threads=threads, workers=workers, log=log)
    seconds = result["seconds"]
    message = f"{result['pictures']} pictures in {sum(seconds['pictures']):.1f} s, loaded in {seconds['loading']:.1f} s"
    listen({"event": "status", "stage": "frames", "message": message})


def simulation_model(run_folder: Path) -> str:
    """The model that the run's own simulations are made with; the usual one where its report does not say."""
    settings = report_or_nothing(run_folder).get("settings")
    return str(settings.get("simulation", Settings.simulation)) if isinstance(settings, dict) else Settings.simulation


def _has_eevee(out: Path, listen: Listener, workers: Workers | None, log: Callable[[str], None]) -> bool:
    """Whether EEVEE renders here; asked of a process of its own, because without OpenGL Blender aborts."""
    listen({"event": "status", "stage": "frames", "message": "checking whether EEVEE works"})
    try:
        make_pictures("try-eevee", {}, out, lambda _: None, workers=workers, log=log)
    except WorkerDefect:
        return False
    return True
