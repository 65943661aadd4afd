"""Report pages of finished runs that were told something afterwards: written anew by a worker, which has Jinja2."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ..core.errors import InputError
from ..core.files.untrusted import is_file
from ..core.runs.layout import REPORT_PAGE
from ..core.runtime.process import Workers
from ..core.runtime.supervisor import Listener, WorkerDefect, finish
from .activity import ACTIVITY
from .background import BackgroundJob, State
from .environment import make_workers
from .messages import show_problem

JOB = "report page"

_TITLE, _STAGE = "Write the Report", "report"


def write_pages_now(folders: Sequence[Path]) -> None:
    """Write the pages of the runs in `folders` that have one, and wait for it, for scripts; a problem is said."""
    try:
        _write(_with_page(folders), make_workers(), lambda _: None)
    except (InputError, WorkerDefect) as error:
        show_problem(_TITLE, str(error))


def start_writing_pages(folders: Sequence[Path]) -> None:
    """Write the pages of the runs in `folders` that have one in the background; a problem pops up."""
    pages = _with_page(folders)
    if pages:
        job = BackgroundJob(_TITLE, partial(_write, pages), make_workers(), (_STAGE,), {_STAGE: 1.0})
        ACTIVITY.start(JOB, job, _say_end)


def _with_page(folders: Sequence[Path]) -> list[Path]:
    return [folder for folder in folders if is_file(folder / REPORT_PAGE)]


def _write(folders: Sequence[Path], workers: Workers, listen: Listener) -> None:
    for folder in folders:
        finish(workers.start_page({"job": "report-page", "folder": str(folder)}), listen)


def _say_end(job: BackgroundJob) -> None:
    if job.state is State.FAILED:
        show_problem(job.title, job.problem)
