"""Does one task of a plan, unless it is done: where engines and kinds of work meet. Standard library only."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..pipeline.continuation import continued
from ..pipeline.launch import run as run_settings
from ..rendering.frames import make_pictures, render
from ..rendering.requests import FramesArguments, LayerArguments, TrainArguments
from ..runs.folder import RunFolder, is_held, lock_exclusively, open_lock
from ..runs.layout import LOG_FILE
from ..runs.report import check_finished_run
from ..runtime.supervisor import Listener, WorkerDefect, all_or_nothing
from ..settings import Settings
from . import page
from .records import forget, is_done, sign_inputs, write_record
from .task import BATCH_FOLDER, Kind, Plan, Task

LOCK_FOLDER = "locks"
_LOCK_POLL_SECONDS = 0.5


def run_task(plan: Plan, name: str, listen: Listener) -> bool:
    """Do the task called `name` if it is not done; returns whether there was anything to do.

    Two processes that are given the same task do not get into each other's way: the second waits for the first.

    Args:
        listen: receives every event.

    Raises:
        InputError: there is no such task, or its input is unusable.
        WorkerDefect: a worker failed, or the outputs are not there afterwards.
        Cancelled: nothing half-written was left.
    """
    task = plan.task(name)
    with _alone(task, plan.out, listen):
        if is_done(task, plan.out):
            listen({"event": "status", "stage": str(task.kind), "message": f"{task.name} is already done"})
            return False
        listen({"event": "status", "stage": str(task.kind), "message": task.name})
        forget(task, plan.out)
        inputs = sign_inputs(task, plan.out)
        started = time.monotonic()
        _WORK[task.kind](task, plan.out, listen)
        try:
            write_record(task, plan.out, inputs, time.monotonic() - started)
        except FileNotFoundError as error:
            raise WorkerDefect(f"{task.name} did not write {error.filename}") from None
    return True


@contextlib.contextmanager
def _alone(task: Task, out: Path, listen: Listener) -> Iterator[None]:
    """Hold the lock of `task`, which vanishes with this process.

    Raises:
        InputError: files cannot be locked there.
    """
    path = out / BATCH_FOLDER / LOCK_FOLDER / task.name
    path.parent.mkdir(parents=True, exist_ok=True)
    with open_lock(path) as lock:
        told = False
        while True:
            try:
                lock_exclusively(lock)
                break
            except OSError as error:
                if not is_held(error):
                    remedy = "choose another folder with --out"
                    raise InputError(f"cannot be locked ({error.strerror})", where=path, remedy=remedy) from None
                if not told:
                    message = f"another process is doing {task.name}; waiting for it"
                    listen({"event": "status", "stage": str(task.kind), "message": message})
                    told = True
                time.sleep(_LOCK_POLL_SECONDS)
        yield


def _train(task: Task, out: Path, listen: Listener) -> None:
    """Make a run, or go on with one that was broken off; it replaces what an earlier one left when it succeeds."""
    arguments = TrainArguments.from_dict(task.arguments)
    run_settings(continued(_settings_in(out, {**arguments.settings, "layers": arguments.layers})), listen)


def _add_layer(task: Task, out: Path, listen: Listener) -> None:
    """Add a layer to a run, unless the run was made with it."""
    arguments = LayerArguments.from_dict(task.arguments)
    settings = _settings_in(out, {**arguments.settings})
    if arguments.source:
        listen({"event": "status", "stage": "start", "message": f"copying {arguments.source}"})
        _copy_run(out / arguments.source, Path(settings.out))
    if settings.layers[0].name not in check_finished_run(Path(settings.out)):
        run_settings(settings, listen)


def _settings_in(out: Path, values: dict[str, Any]) -> Settings:
    """The settings of a run; relative paths start from `out`."""
    return Settings.from_dict({**values, "out": str(out / values["out"]), "capture": str(out / values["capture"])})


def _copy_run(source: Path, target: Path) -> None:
    """Copy a finished run, whole or not at all, in place of one that was there."""
    check_finished_run(source)
    folder = RunFolder(target)
    with all_or_nothing(folder, str(target), LOG_FILE):
        folder.carry_over(source)


def _render_frames(task: Task, out: Path, listen: Listener) -> None:
    """Render pictures of a turntable with as many threads as the task has cores."""
    arguments = FramesArguments.from_dict(task.arguments)
    render(arguments, out, listen, threads=task.cores)


def _make_file(task: Task, out: Path, listen: Listener) -> None:
    """Make a video or a contact sheet of pictures that are there."""
    make_pictures(str(task.kind), task.arguments, out, listen)


_WORK: dict[Kind, Callable[[Task, Path, Listener], None]] = {
    Kind.TRAIN: _train,
    Kind.LAYER: _add_layer,
    Kind.FRAMES: _render_frames,
    Kind.VIDEO: _make_file,
    Kind.SHEET: _make_file,
    Kind.PAGE: page.run,
}
