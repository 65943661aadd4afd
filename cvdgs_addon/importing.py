"""Importing a capture: cameras, photographs and sparse points, in a form that Blender can use as it is.

What a worker wrote before (a run's capture, an earlier import) is read at once. Anything else is undistorted first, by
a worker, into a folder beside the capture, where the photographs stay for the cameras' backgrounds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..core.capture.folder import is_normalised
from ..core.errors import InputError
from ..core.files.untrusted import is_file
from ..core.runs.folder import RunFolder, refuse_foreign_files
from ..core.runs.layout import CAMERAS_FILE, CAPTURE_FOLDER, IMAGES_FOLDER, POINTS_FILE
from ..core.runtime.process import Workers
from ..core.runtime.supervisor import Listener, Log, all_or_nothing, finish
from ..core.settings import AUTO
from .activity import ACTIVITY, redraw_panels, remember_for_undo, scene_by_uid
from .background import BackgroundJob, State
from .environment import make_workers
from .folders import folder_beside, normalised_folder
from .messages import show_information, show_problem
from .scene.import_capture import CaptureObjects, ImportOptions, import_capture

JOB = "import"

_LOG_NAME = "import.log"
_OWN_NAMES = (CAMERAS_FILE, POINTS_FILE, IMAGES_FOLDER, _LOG_NAME)


@dataclass(frozen=True)
class ImportRequest:
    """What to import.

    Attributes:
        folder: of the capture: as photographed, or as a worker wrote it.
        cameras: where they come from, as ``--cameras``.
        options: what is brought in.
    """

    folder: str
    cameras: str = AUTO
    options: ImportOptions = field(default_factory=ImportOptions)


def ready_folder(folder: str) -> Path | None:
    """Where `folder` or the run in it has a capture that Blender can use as it is, or None."""
    for candidate in (Path(folder), Path(folder, CAPTURE_FOLDER)):
        if folder and is_normalised(candidate):
            return candidate
    return None


def import_now(scene: bpy.types.Scene, request: ImportRequest) -> CaptureObjects:
    """Import and wait for it; for scripts, and for what is ready.

    Raises:
        InputError: the capture cannot be used.
        WorkerDefect: the worker failed.
    """
    folder = normalised_folder(request.folder)
    ready = ready_folder(folder) or _normalise(folder, request.cameras, make_workers(), lambda _: None)
    return import_capture(ready, scene, request.options)


def start_import(scene: bpy.types.Scene, request: ImportRequest) -> None:
    """Let a worker prepare the capture in the background, then import it."""
    work = partial(_normalise, normalised_folder(request.folder), request.cameras)
    job = BackgroundJob("Import Capture", work, make_workers(), ("capture",), {"capture": 1.0})
    ACTIVITY.start(JOB, job, partial(_take_over, scene.session_uid, request), ends_with_file=True)


def _normalise(folder: str, cameras: str, workers: Workers, listen: Listener) -> Path:
    """Let a worker write the capture beside itself; returns where."""
    if not folder or not Path(folder).exists():
        raise InputError("no such file or folder", where=folder, remedy="choose a folder of photographs or a video")
    workers.require_python()  # before a folder is made
    out = folder_beside(folder, "Undistorted")
    staged = RunFolder(out, _earlier_files, last=CAMERAS_FILE)
    with all_or_nothing(staged, out, _LOG_NAME), open(staged.staging / _LOG_NAME, "w", encoding="utf-8") as file:
        log = Log(file, listen)
        request: dict[str, Any] = {"job": "normalise", "capture": folder, "cameras": cameras}
        request["folder"] = str(staged.staging)
        finish(workers.start(request, log.line), log.event)
    return Path(out)


def _earlier_files(out: Path) -> list[Path]:
    """What an earlier import may have left in `out`, where its log says that there was one.

    Raises:
        InputError: something is there that no import has made.
    """
    files = [out / name for name in _OWN_NAMES]
    if not is_file(out / _LOG_NAME):
        refuse_foreign_files(files)
    return files


def _take_over(scene_uid: int, request: ImportRequest, job: BackgroundJob) -> None:
    if job.state is State.FAILED:
        show_problem(job.title, job.problem)
    if job.state is not State.DONE:
        return
    scene = scene_by_uid(scene_uid)
    if scene is None:
        show_information(job.title, f"The scene no longer exists; the photographs are in {job.result}")
        return
    try:
        added = import_capture(job.result, scene, request.options)
    except InputError as error:
        show_problem(job.title, str(error))
        return
    remember_for_undo(job.title)
    redraw_panels()
    show_information(job.title, f"Added {len(added.cameras)} cameras to the scene")
