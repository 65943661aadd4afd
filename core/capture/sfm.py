"""Estimates the cameras of photographs: SIFT, matching and incremental mapping by pycolmap on the CPU."""

from __future__ import annotations

import json
import os
import queue
import sqlite3
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import Thread

from ..bootstrap import ROOT
from ..errors import InputError
from ..runtime.protocol import Reporter
from .colmap import add_model
from .colmap_files import read_model
from .images import read_header
from .sfm_process import DATABASE, RESULT, SfmJob, SfmSettings
from .source import SourceModel

_POLL_SECONDS = 0.25
_MESSAGES = {
    "features": "finding features in {count} photographs",
    "matching": "matching {pairs} pairs of photographs",
    "mapping": "estimating the cameras of {count} photographs",
}
_TABLES = {"features": "keypoints", "matching": "two_view_geometries"}


def estimate_cameras(
    folder: Path, names: Sequence[str], workspace: Path, reporter: Reporter, settings: SfmSettings | None = None
) -> SourceModel:
    """Estimate the cameras of photographs.

    Args:
        folder: holds the photographs; nothing is written there.
        names: of the photographs, relative to `folder`, in the order in which they were taken.
        workspace: an empty folder for the database and the result.
        reporter: told of the steps "sfm-features", "sfm-matching" and "sfm-mapping" and their progress. What it raises
            stops the estimation at once.
        settings: the defaults suit two cores.

    Raises:
        InputError: the photographs do not overlap enough.
        RuntimeError: pycolmap ended unexpectedly.
    """
    settings = settings or SfmSettings()
    job = SfmJob(str(folder.resolve()), group_by_camera(folder, names), str(workspace), settings)
    process = _start(job)
    try:
        found = _Watch(process, workspace / DATABASE, job, reporter).wait()
    finally:
        process.kill()
        process.wait()
    if not found:
        raise InputError(
            "no cameras could be estimated from the photographs",
            where=folder,
            remedy="take sharp photographs from different places that overlap by two thirds, or give their cameras",
        )
    model = SourceModel("sfm", folder, [])
    add_model(model, read_model(workspace / RESULT), folder, folder)
    model.views = [replace(view, estimated=True) for view in model.views]
    return model


def group_by_camera(folder: Path, names: Sequence[str]) -> list[list[str]]:
    """`names` by what took them: all of one size, and of one camera and focal length where their EXIF data names it.

    pycolmap would give each photograph without such data (frames of a video, what a messenger passed on) a camera of
    its own, which is then guessed from that photograph alone.
    """
    groups: dict[tuple[int, int, str], list[str]] = {}
    for name in names:
        header = read_header(folder / name)
        groups.setdefault((header.width, header.height, header.taken_with), []).append(name)
    return list(groups.values())


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

    def __init__(self, process: subprocess.Popen[str], database: Path, job: SfmJob, reporter: Reporter) -> None:
        self._process = process
        self._database = database
        count = sum(map(len, job.names))
        self._totals = {"features": count, "matching": job.settings.pairs(count), "mapping": count}
        self._reporter = reporter
        self._step = ""
        self._done = 0
        # None stands for the end of the output.
        self._messages: queue.Queue[str | int | None] = queue.Queue()
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

    def wait(self) -> bool:
        """Until the process says what came of it: whether there is a result."""
        while True:
            try:
                message = self._messages.get(timeout=_POLL_SECONDS)
            except queue.Empty:
                self._look_at_database()
            else:
                if message is None:
                    code = self._process.wait()
                    raise RuntimeError(f"pycolmap ended unexpectedly during {self._step or 'its start'} (exit {code})")
                if message in ("done", "nothing"):
                    return message == "done"
                self._receive(message)
            self._report()

    def _look_at_database(self) -> None:
        if self._step in _TABLES:
            self._done = max(self._done, _count_rows(self._database, _TABLES[self._step]))

    def _report(self) -> None:
        if self._step:
            total = self._totals[self._step]
            done = min(self._done, total)
            self._reporter.progress(f"sfm-{self._step}", done / total, f"{done} of {total}")

    def _receive(self, message: str | int) -> None:
        if isinstance(message, int):
            self._done = message
            return
        self._step, self._done = message, 0
        text = _MESSAGES[message].format(count=self._totals["features"], pairs=self._totals["matching"])
        self._reporter.status(f"sfm-{message}", text)


def _parse(line: str) -> str | int | None:
    """The message in `line`; None where a library printed something."""
    try:
        message = json.loads(line)
    except ValueError:
        return None
    return message if message in (*_MESSAGES, "done", "nothing") or type(message) is int else None


def _count_rows(database: Path, table: str) -> int:
    """Rows that have reached the database file; 0 while it cannot be read.

    It is opened as immutable, that is without locks: pycolmap ends its process when it finds the database locked.
    """
    try:
        connection = sqlite3.connect(f"{database.as_uri()}?immutable=1", uri=True)
        try:
            (rows,) = connection.execute(f"SELECT COUNT(*) FROM {table}").fetchone()
        finally:
            connection.close()
    except sqlite3.Error:
        return 0
    return int(rows)
