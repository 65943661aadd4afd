"""Estimates the cameras of photographs: SIFT, matching, global and incremental mapping by pycolmap on the CPU."""

from __future__ import annotations

import errno
import json
import os
import queue
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bootstrap import ROOT
from ..errors import InputError
from ..runtime.devices import AFTER_KILLED, WHY_KILLED
from ..runtime.progress import CAMERAS
from ..runtime.protocol import Reporter
from .colmap import add_model
from .colmap_files import read_model
from .images import read_header
from .model import Estimate
from .sfm_images import PLAIN, copy_name
from .sfm_job import DATABASE, REFUSAL, RESULT, Placed, SfmJob, SfmSettings
from .sfm_verdict import Frame, contact_sheet, read_frames, require_enough, say_left_out
from .source import SourceModel

_POLL_SECONDS = 0.25
_MESSAGES = {
    "reading": "reading {count} photographs",
    "features": "finding features in {count} photographs",
    "matching": "matching up to {pairs} pairs of photographs",
    "mapping": "estimating the cameras of {count} photographs",
}
_MORE = "more "  # before the name of a step that is done again with more effort
# Of the time of an estimation on two cores, when what its steps begin with is enough.
_SHARES = {"reading": 0.05, "features": 0.25, "matching": 0.5, "mapping": 0.2}
# Mapping places photographs again and again, all at once or one by one.
_DONE = {
    "reading": "{done} of {total} photographs read",
    "features": "features found in {done} of {total} photographs",
    "matching": "{done} of {total} pairs matched",
    "mapping": "{share:.0%} of the photographs placed",
}
_FULL_DISK = 1 << 20  # bytes that are left of one that is full


def estimate_cameras(
    folder: Path,
    names: Sequence[str],
    workspace: Path,
    reporter: Reporter,
    settings: SfmSettings | None = None,
    masks: Mapping[str, Path] | None = None,
    root: Path | None = None,
) -> SourceModel:
    """Estimate the cameras of photographs.

    Args:
        folder: holds the photographs; nothing is written there. Frames of a video are listed in a `FRAMES_FILE`.
        names: of the photographs, relative to `folder`, in the order in which they were taken.
        workspace: an empty folder for the database and the result.
        reporter: told of the stage `CAMERAS`, how long it will take and how far it is; that falls back where it is
            tried with more effort. What it raises stops the estimation at once.
        settings: the defaults suit two cores.
        masks: of photographs, by name: no features are sought in what they leave out.
        root: the capture folder, in which a `FRAMES_FILE` may also lie beside `folder`.

    Raises:
        InputError: the photographs do not overlap enough, or the machine lacks memory or space.
        OSError: the disk is full.
        RuntimeError: pycolmap ended unexpectedly.
    """
    settings = settings or SfmSettings()
    frames = read_frames(folder, root)
    names = _in_order(names, frames)
    cameras = number_cameras(folder, names, frames)
    masks = masks or {}
    mask_files = {name: str(path.resolve()) for name, path in masks.items()}
    job = SfmJob(str(folder.resolve()), names, cameras, str(workspace), settings, mask_files)
    header = read_header(folder / names[0])
    reporter.forecast({CAMERAS: settings.seconds(len(names), header.width, header.height)})
    process = _start(job)
    try:
        placed = _Watch(process, workspace, job, reporter).wait()
    finally:
        process.kill()
        process.wait()
    require_enough(placed, names, folder)
    model = SourceModel("sfm", folder, [])
    add_model(model, read_model(workspace / RESULT), folder, folder)
    model.views = [replace(view, estimated=True, mask=masks.get(view.name)) for view in model.views]
    model.warnings = [warning for warning in model.warnings if warning.name != "unregistered"]
    left_out = say_left_out(placed, names, frames)
    if left_out:
        model.warn("not-placed", f"{folder}: {left_out}")
    model.estimate = Estimate(
        photographs=len(names),
        placed=len(placed.names),
        pieces=tuple(placed.pieces),
        focal_ratios=tuple(placed.lenses),
        method=placed.method,
        sheet=_sheet(job, placed) if left_out else None,
    )
    return model


def _in_order(names: Sequence[str], frames: Mapping[str, Frame]) -> list[str]:
    """`names`, those of frames by video and time; photographs among them come first, in their own order."""
    photographs = [name for name in names if name not in frames]
    filmed = [name for name in names if name in frames]
    return [*photographs, *sorted(filmed, key=lambda name: (frames[name].video, frames[name].time))]


def _sheet(job: SfmJob, placed: Placed) -> NDArray[np.uint8]:
    """Read from the copies, which are small."""
    copies = (Path(job.workspace) / PLAIN / copy_name(index) for index in range(len(job.names)))
    files = [(copy, Path(job.folder) / name) for copy, name in zip(copies, job.names, strict=True)]
    with_place = set(placed.names)
    return contact_sheet(files, [name in with_place for name in job.names])


def number_cameras(folder: Path, names: Sequence[str], frames: Mapping[str, Frame]) -> list[int]:
    """For each of `names` the number of the camera that took it, counted from 0.

    One camera took what is of one size, of one video, and of one camera, focal length and digital zoom where EXIF data
    name them. pycolmap would give each photograph without such data (frames of a video, what a messenger passed on) a
    camera of its own, which is then guessed from that photograph alone.
    """
    numbers: dict[tuple[int, int, str, str], int] = {}
    cameras = []
    for name in names:
        header = read_header(folder / name)
        video = frames[name].video if name in frames else ""
        taken_by = (header.width, header.height, header.taken_with, video)
        cameras.append(numbers.setdefault(taken_by, len(numbers)))
    return cameras


def _start(job: SfmJob) -> subprocess.Popen[str]:
    """Start the process with this interpreter, this very tree and the job."""
    program = (
        f"import sys; sys.path.insert(0, {str(ROOT / 'core')!r}); import bootstrap; bootstrap.load(); "
        "from cvdgs.core.capture.sfm_process import main; main()"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        encoding="utf-8",
    )
    assert process.stdin is not None
    try:
        process.stdin.write(job.to_json() + "\n")
        process.stdin.close()
    except BrokenPipeError:
        # It died at once; the watch finds its output closed and says so.
        pass
    return process


class _Watch:
    """Follows the process and tells the reporter."""

    def __init__(self, process: subprocess.Popen[str], workspace: Path, job: SfmJob, reporter: Reporter) -> None:
        self._process = process
        self._workspace = workspace
        count = len(job.names)
        pairs = (job.settings.first or job.settings).pairs(count)
        self._totals = {"reading": count, "features": count, "matching": pairs, "mapping": count}
        self._pairs = job.settings.pairs(count)  # with more effort
        self._reporter = reporter
        self._step, self._effort, self._done = "", 0, 0
        # None stands for the end of the output.
        self._messages: queue.Queue[str | int | dict[str, Any] | None] = queue.Queue()
        Thread(target=self._read, name="sfm-messages", daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        try:
            for line in self._process.stdout:
                message = _parse(line)
                if message is not None:
                    self._messages.put(message)
        finally:
            self._messages.put(None)

    def wait(self) -> Placed:
        """Until the process says what came of it."""
        while True:
            try:
                message = self._messages.get(timeout=_POLL_SECONDS)
            except queue.Empty:
                self._look_at_database()
            else:
                if message is None:
                    raise self._fault(self._process.wait())
                if isinstance(message, dict) and REFUSAL in message:
                    what, where, remedy = message[REFUSAL]
                    raise InputError(what, where=where, remedy=remedy)
                if isinstance(message, dict):
                    return Placed(**message)
                self._receive(message)
            self._report()

    def _fault(self, code: int) -> Exception:
        """Why the process ended without a word, by its exit code (negative: by a signal)."""
        during = self._step or "its start"
        if code == -9:  # SIGKILL, a name that Windows does not have
            return InputError(f"pycolmap was killed during {during}, {WHY_KILLED}", remedy=AFTER_KILLED)
        # It aborts where its database cannot be written, and does not say why.
        if shutil.disk_usage(self._workspace).free < _FULL_DISK:
            return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._workspace))
        return RuntimeError(f"pycolmap ended unexpectedly during {during} (exit {code})")

    def _look_at_database(self) -> None:
        if self._step == "features":
            self._done = max(self._done, _count_features(self._workspace / f"{self._effort}-{DATABASE}"))

    def _report(self) -> None:
        if self._step:
            steps, total = tuple(_SHARES), self._totals[self._step]
            done = min(self._done, total)
            before = sum(_SHARES[step] for step in steps[: steps.index(self._step)])
            said = _DONE[self._step].format(done=done, total=total, share=done / total)
            self._reporter.progress(CAMERAS, before + _SHARES[self._step] * done / total, said)

    def _receive(self, message: str | int) -> None:
        if isinstance(message, int):
            self._done = message
            return
        self._step, self._done = message.removeprefix(_MORE), 0
        if message == f"{_MORE}features":
            self._effort += 1
            self._totals["matching"] = self._pairs
        text = _MESSAGES[self._step].format(count=self._totals["features"], pairs=self._totals["matching"])
        self._reporter.status(CAMERAS, f"{text}, with more effort" if self._effort else text)


def _parse(line: str) -> str | int | dict[str, Any] | None:
    """The message in `line`; None where a library printed something."""
    try:
        message = json.loads(line)
    except ValueError:
        return None
    is_step = isinstance(message, str) and message.removeprefix(_MORE) in _MESSAGES
    return message if is_step or type(message) is int or isinstance(message, dict) else None


def _count_features(database: Path) -> int:
    """Photographs whose features have reached the database file; 0 while it cannot be read.

    It is opened as immutable, that is without locks: pycolmap ends its process when it finds the database locked.
    """
    try:
        connection = sqlite3.connect(f"{database.as_uri()}?immutable=1", uri=True)
        try:
            (rows,) = connection.execute("SELECT COUNT(*) FROM keypoints").fetchone()
        finally:
            connection.close()
    except sqlite3.Error:
        return 0
    return int(rows)
