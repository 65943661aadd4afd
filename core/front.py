"""A run as its user meets it on a console: workers, progress, results put in place. Standard library only."""

from __future__ import annotations

import json
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from .errors import Cancelled, InputError
from .job import WORKER, Event, Job, blender_command, find_python
from .progress import RunProgress, format_seconds
from .report import finish_report
from .run_folder import RunFolder
from .settings import Settings

EXIT_DONE, EXIT_DEFECT, EXIT_INPUT, EXIT_CANCELLED = 0, 1, 2, 130
LOG_NAME = "run.log"


class WorkerDefect(Exception):
    """A worker ended without a result: a defect of ours, described in one line."""


class WorkerRefusal(InputError):
    """A worker's own complaint about the input, already one line."""

    def __str__(self) -> str:
        return self.what


def run_in_console(settings: Settings, *, json_events: bool) -> int:
    """Run `settings` with progress on the console; returns the exit code of the contract.

    Args:
        json_events: write the events to stdout as JSON lines instead of a progress bar on stderr.
    """
    stages = (
        "start",
        "capture",
        "geometry",
        "enhance",
        "layers",
        "evaluate",
        *(("blender",) if settings.blend else ()),
    )
    display: Callable[[Event], None] = _JsonDisplay(sys.stdout) if json_events else _BarDisplay(sys.stderr, stages)
    previous = {number: signal.signal(number, _cancel) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        report = run(settings, display)
    except InputError as error:
        display({"event": "error", "kind": "input", "message": str(error)})
        return EXIT_INPUT
    except Cancelled:
        display({"event": "error", "kind": "cancelled", "message": "cancelled; nothing was written"})
        return EXIT_CANCELLED
    except WorkerDefect as error:
        display({"event": "error", "kind": "defect", "message": str(error)})
        return EXIT_DEFECT
    finally:
        for number, handler in previous.items():
            if handler is not None:  # None: set by the program around us (Blender), and Python cannot put it back
                signal.signal(number, handler)
    display({"event": "result", "out": settings.out, "report": report})
    return EXIT_DONE


def run(settings: Settings, listen: Callable[[Event], None]) -> dict[str, Any]:
    """Run the whole job and put its results into ``settings.out``; returns the report.

    Args:
        listen: receives every event of the workers.

    Raises:
        InputError: unusable input or output; nothing was written.
        Cancelled: nothing was written.
        WorkerDefect: a worker failed; its log is kept in the output folder.
    """
    started = time.monotonic()
    listen({"event": "status", "stage": "start", "message": "starting"})
    python = find_python()
    folder = RunFolder(settings.out)
    try:
        with open(folder.staging / LOG_NAME, "w", encoding="utf-8") as log_file:
            log = _Log(log_file, listen)
            log.line("settings " + json.dumps(settings.to_dict()))
            request = {"job": "run", "settings": settings.to_dict(), "folder": str(folder.staging)}
            report = _finish(Job([python, str(WORKER)], request, log.line), log.event)["report"]
            if settings.blend:
                blender_started = time.monotonic()
                # A held-out view from the middle: its still can be compared with renders/.
                shown = report["views_shown"]
                arguments = [str(folder.staging), "--view", shown[len(shown) // 2]]
                blender = _finish(Job(blender_command(arguments), None, log.line), log.event)
                blender.pop("event")
                report["blender"] = blender
                report["seconds"]["blender"] = round(time.monotonic() - blender_started, 2)
            report["seconds"]["total"] = round(time.monotonic() - started, 2)
            finish_report(folder.staging, report)
        folder.commit()
    except WorkerDefect as error:
        kept = folder.abort(keep=LOG_NAME)
        raise WorkerDefect(f"{error} - this is a defect of ours; please report it with {kept}") from None
    except OSError as error:
        folder.abort()
        raise InputError(
            f"cannot be written to ({error.strerror})", where=settings.out, remedy="free space or choose another --out"
        ) from None
    except BaseException:
        folder.abort()
        raise
    return report


def _finish(job: Job, listen: Callable[[Event], None]) -> Event:
    """Follow `job` to its end and return its result."""
    result: Event | None = None
    complaint: Event | None = None
    try:
        for event in job.events():
            if event["event"] == "result":
                result = event
            elif event["event"] == "error":
                complaint = event
            else:
                listen(event)
        code = job.wait()
    except BaseException:
        job.cancel()
        raise
    if complaint is not None and complaint.get("kind") == "input":
        raise WorkerRefusal(str(complaint["message"]))
    if code != 0 or result is None:
        raise WorkerDefect(str(complaint["message"]) if complaint else _describe_end(code))
    return result


def _describe_end(code: int) -> str:
    if code == -signal.SIGKILL:
        return "the worker was killed, most likely because the machine ran out of memory"
    return f"the worker was ended by signal {-code}" if code < 0 else f"the worker ended with exit code {code}"


def _cancel(*_: object) -> None:
    raise Cancelled


class _Log:
    """Time-stamped lines of everything that happens, and the way of the events to the display."""

    def __init__(self, file: TextIO, listen: Callable[[Event], None]) -> None:
        self._file = file
        self._listen = listen
        self._started = time.monotonic()

    def line(self, text: str) -> None:
        self._file.write(f"{time.monotonic() - self._started:9.2f} {text}\n")
        self._file.flush()

    def event(self, event: Event) -> None:
        self.line(json.dumps(event))
        self._listen(event)


class _JsonDisplay:
    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __call__(self, event: Event) -> None:
        self._stream.write(json.dumps(event) + "\n")
        self._stream.flush()


class _BarDisplay:
    """One line that is rewritten on a terminal; elsewhere a line now and then."""

    _QUIET_INTERVAL = 10.0  # seconds between lines when the stream is no terminal

    def __init__(self, stream: TextIO, stages: tuple[str, ...]) -> None:
        self._stream = stream
        self._terminal = stream.isatty()
        self._progress = RunProgress(stages)
        self._last_line = 0.0
        self._last_stage = ""

    def __call__(self, event: Event) -> None:
        kind = event["event"]
        if kind in ("status", "progress"):
            self._progress.update(event)
            self._show()
        elif kind == "warning":
            self._say(f"note: {event['message']}")
        elif kind == "error":
            self._say(f"run.py: {event['message']}")
        elif kind == "result":
            self._say(_summary(Path(event["out"]), event["report"]))

    def _show(self) -> None:
        progress = self._progress
        left = progress.seconds_left
        text = f"{progress.fraction:4.0%} {progress.stage:<9}"
        text += f" {format_seconds(left)} left" if left is not None else " " * 10
        text += f"  {progress.message}"
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            self._stream.write("\r" + text[:width].ljust(width))
        elif progress.stage != self._last_stage or time.monotonic() - self._last_line >= self._QUIET_INTERVAL:
            self._stream.write(text.rstrip() + "\n")
            self._last_line, self._last_stage = time.monotonic(), progress.stage
        self._stream.flush()

    def _say(self, text: str) -> None:
        if self._terminal:
            self._stream.write("\r" + " " * (shutil.get_terminal_size().columns - 1) + "\r")
        self._stream.write(text + "\n")
        self._stream.flush()


def _summary(out: Path, report: dict[str, Any]) -> str:
    seconds, reconstruction = report["seconds"], report["reconstruction"]
    psnr = "-" if reconstruction["psnr"] is None else f"{reconstruction['psnr']:.2f} dB on held-out views"
    lines = [f"done in {format_seconds(seconds['total'])}: {report['gaussians']} Gaussians, {psnr}"]
    for name, layer in report["layers"].items():
        ccpr = layer["ccpr"]
        if ccpr["rendered"] is not None:
            kinds = (("photographs", "input"), ("scene", "unenhanced"), ("enhanced scene", "rendered"))
            values = ", ".join(f"{label} {ccpr[kind]:.3f}" for label, kind in kinds)
            lines.append(f"  {name}: contrast that is left (CCPR): {values}")
    lines.append(f"  open {out / 'report.html'}" + (f" and {out / 'scene.blend'}" if report.get("blender") else ""))
    return "\n".join(lines)
