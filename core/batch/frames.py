"""Tasks that render pictures of a turntable. Standard library only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..job import Workers
from ..job_console import Listener, WorkerDefect
from ..settings import Settings
from .arguments import FramesArguments
from .finished import report_or_nothing
from .pictures import make_pictures, to_stderr
from .task import Task

_CYCLES, _EEVEE = "cycles", "eevee"


def run(task: Task, out: Path, listen: Listener) -> None:
    """Render the task's pictures, with as many threads as the task has cores; for its errors see `render`."""
    arguments = FramesArguments.from_dict(task.arguments)
    render(arguments, out, listen, threads=task.cores, model=simulation_model(out / arguments.run))


def render(
    arguments: FramesArguments,
    out: Path,
    listen: Listener,
    *,
    threads: int,
    model: str,
    workers: Workers | None = None,
    log: Callable[[str], None] = to_stderr,
) -> None:
    """Render pictures of a turntable.

    Where there is no OpenGL, Cycles takes EEVEE's place, and `listen` hears of it.

    Args:
        out: folder that the arguments' paths start from.
        threads: of the renderer; 0: as many as the processor has.
        model: of the simulation for observers.
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
    fields: dict[str, Any] = {"threads": threads, "workers": workers, "log": log, "model": model}
    result = make_pictures("frames", arguments.to_dict(), out, listen, **fields)
    seconds = result["seconds"]
    message = f"{result['pictures']} pictures in {sum(seconds['pictures']):.1f} s, loaded in {seconds['loading']:.1f} s"
    listen({"event": "status", "stage": "frames", "message": message})


def simulation_model(run_folder: Path) -> str:
    """The model that the run's own simulations are made with; the usual one where its report does not say."""
    settings = report_or_nothing(run_folder).get("settings")
    return str(settings.get("simulation", Settings.simulation)) if isinstance(settings, dict) else Settings.simulation


def _has_eevee(out: Path, listen: Listener, workers: Workers | None, log: Callable[[str], None]) -> bool:
    """Whether EEVEE renders here; asked of a process of its own, because without OpenGL Blender aborts."""
    listen({"event": "status", "stage": "frames", "message": "trying EEVEE"})
    try:
        make_pictures("try-eevee", {}, out, lambda _: None, workers=workers, log=log)
    except WorkerDefect:
        return False
    return True
