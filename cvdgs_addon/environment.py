"""The interpreter of the worker: chosen in the preferences, made by one button, or found; and jobs that need it."""

from __future__ import annotations

import json
import os
import shutil
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..core.bootstrap import OLDEST_PYTHON
from ..core.errors import InputError
from ..core.runtime.environment import (
    STAGE,
    can_make_environments,
    discard_environment,
    is_complete,
    is_outdated,
    python_in,
)
from ..core.runtime.process import WORKER, Workers, find_python
from ..core.runtime.supervisor import Listener, finish
from .activity import ACTIVITY
from .background import BackgroundJob, State
from .folders import user_folder
from .messages import show_information, show_problem
from .preferences import get_cache, get_preferences, remember, shrink_cache

MAKE_JOB, CHECK_JOB = "environment", "check"
DOWNLOAD_SIZE = "400 MB to download and 2 GB on disk (several times that if torch comes with CUDA libraries)"

_FOLDER = "environment"
_SET_UP = "open the add-on's preferences and set up the worker"
# The first is the version that everything was tested and pinned with; Blender's own comes next.
_TESTED_NAME, _NAMES = "python3.11", ("python3.12", "python3.13", "python3", "python")


def environment_folder() -> Path:
    """Where the button makes the environment."""
    return user_folder() / _FOLDER


def worker_python() -> str:
    """The interpreter that workers are started with.

    Raises:
        InputError: none is chosen, made or found.
    """
    chosen = bpy.path.abspath(get_preferences().python)
    if chosen:
        if not os.path.isfile(chosen) or not os.access(chosen, os.X_OK):
            remedy = "correct Worker Python in the preferences"
            raise InputError("is not an executable program", where=chosen, remedy=remedy)
        return chosen
    if is_complete(environment_folder()):
        return str(python_in(environment_folder()))
    try:
        return find_python()
    except InputError:
        is_old = is_outdated(environment_folder())
        what = "the worker is that of another version of the add-on" if is_old else "there is no worker yet"
        raise InputError(what, remedy=_SET_UP) from None


def why_no_worker() -> str:
    """Why no worker can be started, for somebody who sees the preferences; "" where one can be."""
    try:
        worker_python()
    except InputError as error:
        if error.where:
            return f"{error.where} {error.what}"
        if is_outdated(environment_folder()):
            return "The worker is that of another version of the add-on: Set Up Worker replaces it"
        return "Choose Worker Python below, or Set Up Worker"
    return ""


def make_workers() -> Workers:
    """What starts workers with the interpreter of the preferences; refuses only when one is to be started."""
    variables = {"WARP_CACHE_PATH": str(get_cache().kernels)}
    try:
        return Workers(worker_python(), variables, low_priority=True)
    except InputError:
        return _NoWorkers(variables=variables, low_priority=True)


class _NoWorkers(Workers):
    """Says what to do when there is no interpreter."""

    def require_python(self) -> str:
        return worker_python()


def start_check() -> None:
    """Check the worker in the background: versions, device and speed go into the preferences."""
    device = get_preferences().device

    def work(workers: Workers, listen: Listener) -> dict[str, Any]:
        found = finish(workers.start({"job": "check", "device": device}, _to_console), listen)["machine"]
        return {**found, "asked_of": workers.require_python()}

    job = BackgroundJob("Checking the worker", work, make_workers(), ("check",), {"check": 1.0})
    ACTIVITY.start(CHECK_JOB, job, _take_over_check)


def start_making(base_python: str) -> None:
    """Make the environment in the background, from the interpreter `base_python`."""
    work = partial(_make, base_python, environment_folder())
    job = BackgroundJob("Setting up the worker", work, Workers(base_python, low_priority=True), (STAGE,), {STAGE: 1.0})
    ACTIVITY.start(MAKE_JOB, job, _take_over_environment)


def remove_environment() -> None:
    """Delete the environment that was made.

    Raises:
        InputError: another Blender is making it, or the system refuses.
    """
    ACTIVITY.end(MAKE_JOB)
    folder = environment_folder()
    try:
        discard_environment(folder)
    except OSError as error:
        what = f"cannot be removed ({error.strerror})"
        raise InputError(what, where=folder, remedy="check its permissions") from None
    remember(machine="")


def find_base_python() -> str:
    """An interpreter that can make environments: the preferences', one of this system, or Blender's own.

    Raises:
        InputError: there is none.
    """
    chosen = bpy.path.abspath(get_preferences().base_python)
    candidates = [chosen] if chosen else [shutil.which(_TESTED_NAME), sys.executable, *map(shutil.which, _NAMES)]
    for candidate in candidates:
        if candidate and can_make_environments(candidate):
            return candidate
    version = ".".join(map(str, OLDEST_PYTHON))
    raise InputError(
        f"no Python {version} or later that can create environments was found",
        where=chosen,
        remedy="install one from python.org (Debian: python3-venv), and choose it as Base Python for Setup",
    )


def _make(base_python: str, folder: Path, workers: Workers, listen: Listener) -> str:
    """Make the environment and return its interpreter; a failure or a cancellation leaves nothing."""
    request = {"job": "make-environment", "folder": str(folder)}
    try:
        return finish(workers.start_command([base_python, str(WORKER)], request, _to_console), listen)["python"]
    except BaseException:
        with suppress(InputError, OSError):  # what is there is another Blender's
            discard_environment(folder)
        raise


def _to_console(line: str) -> None:
    """What the worker and pip say besides, for those who look for a reason."""
    print(line, file=sys.stderr)


def _take_over_environment(job: BackgroundJob) -> None:
    if job.state is State.FAILED:
        show_problem(job.title, job.problem)
    elif job.state is State.DONE:
        show_information(job.title, "The worker is set up and is now being checked")
        start_check()


def _take_over_check(job: BackgroundJob) -> None:
    if job.state is State.FAILED:
        remember(machine="")
        show_problem(job.title, job.problem)
    elif job.state is State.DONE:
        remember(machine=json.dumps(job.result), speed=float(job.result["speed"]))
        shrink_cache()
