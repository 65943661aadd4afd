"""A worker's job as its user meets it on a console: signals, progress, errors, exit codes. Standard library only."""

from __future__ import annotations

import contextlib
import json
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from typing import TextIO

from .errors import Cancelled, InputError
from .job import Event, Job
from .progress import RunProgress, format_seconds
from .run_folder import RunFolder

EXIT_DONE, EXIT_DEFECT, EXIT_INPUT, EXIT_CANCELLED = 0, 1, 2, 130

Listener = Callable[[Event], None]


class WorkerDefect(Exception):
    """A worker ended without a result: a defect of ours, described in one line."""


class WorkerRefusal(InputError):
    """A worker's own complaint about the input, already one line."""

    def __str__(self) -> str:
        return self.what


def in_console(
    work: Callable[[Listener], Event], display: Listener, *, cancelled: str = "cancelled; nothing was written"
) -> int:
    """Do `work` so that Ctrl-C cancels it and every failure is one line; returns the exit code of the contract.

    Args:
        work: takes a listener for the events of its workers and returns the fields of the result.
        display: shows events, the final result or error included.
        cancelled: what to say when the user has cancelled it.
    """
    previous = {number: signal.signal(number, _cancel) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        result = work(display)
    except InputError as error:
        display({"event": "error", "kind": "input", "message": str(error)})
        return EXIT_INPUT
    except Cancelled:
        display({"event": "error", "kind": "cancelled", "message": cancelled})
        return EXIT_CANCELLED
    except WorkerDefect as error:
        display({"event": "error", "kind": "defect", "message": str(error)})
        return EXIT_DEFECT
    finally:
        for number, handler in previous.items():
            if handler is not None:  # None: set by the program around us (Blender), and Python cannot put it back
                signal.signal(number, handler)
    display({"event": "result", **result})
    return EXIT_DONE


@contextlib.contextmanager
def all_or_nothing(folder: RunFolder, out: str, log_name: str) -> Iterator[None]:
    """Put what the block stages into `folder` in place when it succeeds, and nothing when it does not.

    Args:
        folder: of the block.
        out: the folder as the user named it.
        log_name: of the staged log, which is kept when a worker failed.

    Raises:
        InputError: the results could not be written.
        WorkerDefect: with the place of the log.
    """
    try:
        yield
        folder.commit()
    except WorkerDefect as error:
        kept = folder.abort(keep=log_name)
        raise WorkerDefect(f"{error} - this is a defect of ours; please report it with {kept}") from None
    except OSError as error:
        folder.abort()
        what, remedy = f"cannot be written to ({error.strerror})", "free space or choose another --out"
        raise InputError(what, where=out, remedy=remedy) from None
    except BaseException:
        folder.abort()
        raise


def finish(job: Job, listen: Listener) -> Event:
    """Follow `job` to its end and return its result.

    Raises:
        WorkerRefusal: the worker refused its input.
        Cancelled: another thread cancelled it.
        WorkerDefect: it ended without a result.
    """
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
    if job.cancelled:
        raise Cancelled
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


class Log:
    """Time-stamped lines of everything that happens, and the way of the events to the display."""

    def __init__(self, file: TextIO, listen: Listener) -> None:
        self._file = file
        self._listen = listen
        self._started = time.monotonic()

    def line(self, text: str) -> None:
        """Write one line."""
        self._file.write(f"{time.monotonic() - self._started:9.2f} {text}\n")
        self._file.flush()

    def event(self, event: Event) -> None:
        """Write an event and pass it on."""
        self.line(json.dumps(event))
        self._listen(event)


class JsonDisplay:
    """Events as JSON lines."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __call__(self, event: Event) -> None:
        self._stream.write(json.dumps(event) + "\n")
        self._stream.flush()


class BarDisplay:
    """One line that is rewritten on a terminal; elsewhere a line now and then.

    Args:
        stream: where to, usually stderr.
        program: name of the script, said before an error.
        progress: that of the whole job.
        summarise: what to say of a result.
    """

    _QUIET_INTERVAL = 10.0  # seconds between lines when the stream is no terminal

    def __init__(self, stream: TextIO, program: str, progress: RunProgress, summarise: Callable[[Event], str]) -> None:
        self._stream = stream
        self._program, self._progress, self._summarise = program, progress, summarise
        self._terminal = stream.isatty()
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
            self._say(f"{self._program}: {event['message']}")
        elif kind == "result":
            self._say(self._summarise(event))

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
