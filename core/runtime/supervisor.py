"""A worker's job on the console: signals, progress, errors, exit codes. Standard library only."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import TextIO

from ..errors import Cancelled, InputError
from ..runs.folder import RunFolder
from .devices import AFTER_KILLED, WHY_KILLED
from .process import Event, Job
from .progress import RunProgress, format_seconds
from .protocol import EXIT_CANCELLED, EXIT_DEFECT, EXIT_DONE, EXIT_INPUT

# A worker that says nothing for so long may be stuck. It may also swap, or render a large picture, so this is said and
# the user decides; compiling the kernels, the longest silence of a healthy run, takes about a minute.
PATIENCE_SECONDS = 120.0

CANCELLED = "cancelled; nothing was written"

# Signals by which a worker is ended by somebody else.
_FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")

Listener = Callable[[Event], None]


class WorkerDefect(Exception):
    """A worker ended without a result: a defect of ours, described in one line."""


class WorkerKilled(WorkerDefect):
    """A worker was ended by somebody else: the system when its memory ran out, a user, a farm."""


class WorkerRefusal(InputError):
    """A worker's own complaint about the input, already one line."""

    def __str__(self) -> str:
        return self.what


def in_console(
    work: Callable[[Listener], Event], display: Listener, *, cancelled: Callable[[], str] = lambda: CANCELLED
) -> int:
    """Do `work` so that Ctrl-C cancels it and every failure is one line; returns the exit code of the contract.

    Args:
        work: takes a listener for the events of its workers and returns the fields of the result.
        display: shows events, the final result or error included.
        cancelled: gives what to say when the user has cancelled it.
    """
    with cancelled_by_signals():
        try:
            result = work(display)
        except InputError as error:
            _tell(display, {"event": "error", "kind": "input", "message": str(error)})
            return EXIT_INPUT
        except Cancelled:
            _tell(display, {"event": "error", "kind": "cancelled", "message": cancelled()})
            return EXIT_CANCELLED
        except WorkerDefect as error:
            _tell(display, {"event": "error", "kind": "defect", "message": str(error)})
            return EXIT_DEFECT
    _tell(display, {"event": "result", **result})
    return EXIT_DONE


def cancelled_by_signals() -> AbstractContextManager[None]:
    """Ctrl-C, and what a farm or a service sends to end this process, raise `Cancelled` in the block."""
    return handling_signals(_cancel_once(), signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def handling_signals(handler: Callable[..., None], *numbers: signal.Signals) -> Iterator[None]:
    """Let `handler` be called for signals of these `numbers` in the block."""
    previous = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in previous.items():
            if earlier is not None:  # None: set by the program around us (Blender), and Python cannot put it back
                signal.signal(number, earlier)


def _tell(display: Listener, event: Event) -> None:
    """Show how the work ended, which it has, whether anybody reads that or not."""
    with contextlib.suppress(Cancelled):
        display(event)


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
    except WorkerKilled as error:
        kept = folder.abort(keep=log_name)
        raise WorkerKilled(f"{error} (its log is {kept})") from None
    except WorkerDefect as error:
        kept = folder.abort(keep=log_name)
        raise WorkerDefect(f"{error} - this is a defect of ours; please report it with {kept}") from None
    except OSError as error:
        folder.abort()
        reason = error.strerror or error  # a pipe in a folder that is copied is Python's own refusal
        what, remedy = f"cannot be written to ({reason})", "free space or choose another folder with --out"
        raise InputError(what, where=out, remedy=remedy) from None
    except BaseException:
        folder.abort()
        raise


def finish(job: Job, listen: Listener, patience_seconds: float | None = PATIENCE_SECONDS) -> Event:
    """Follow `job` to its end and return its result.

    Args:
        listen: receives its events but the last.
        patience_seconds: `listen` is warned once a stage when nothing is heard for so long; None waits without a word.

    Raises:
        WorkerRefusal: the worker refused its input.
        Cancelled: another thread cancelled it.
        WorkerKilled: it was ended from outside.
        WorkerDefect: it ended without a result.
        OSError: what it said could not be logged.
    """
    result: Event | None = None
    complaint: Event | None = None
    stage = ""
    warned_in: str | None = None

    def warn_of_silence() -> None:
        nonlocal warned_in
        if warned_in != stage:
            warned_in = stage
            listen(_silence(stage, patience_seconds or 0.0))

    try:
        for event in job.events(patience_seconds, warn_of_silence):
            if event["event"] == "result":
                result = event
            elif event["event"] == "error":
                complaint = event
            else:
                stage = str(event.get("stage", stage))
                listen(event)
        code = job.wait()
    except BaseException:
        job.cancel()
        raise
    if job.cancelled:
        raise Cancelled
    if complaint is not None and complaint.get("kind") == "input":
        raise WorkerRefusal(str(complaint["message"]))
    if job.log_failure is not None:
        raise job.log_failure
    if complaint is not None and (code != 0 or result is None):
        raise WorkerDefect(str(complaint["message"]))
    if code != 0 or result is None:
        raise _end_without_result(code, f" during '{stage}'" if stage else "")
    return result


def _silence(stage: str, seconds: float) -> Event:
    where = f" in '{stage}'" if stage else ""
    message = (
        f"the worker has been silent for {format_seconds(seconds)}{where}; it may be busy or stuck - if this goes "
    )
    message += "on, cancel and run again: an earlier result stays untouched until a run succeeds"
    return {"event": "warning", "name": "silent-worker", "message": message}


def _end_without_result(code: int, during: str) -> WorkerDefect:
    """What became of a worker that ended with `code` (negative: by a signal) and gave neither result nor reason."""
    if code == EXIT_CANCELLED:
        return WorkerKilled(f"the worker was told to stop by another program{during} - run again")
    if code >= 0:
        return WorkerDefect(f"the worker ended with exit code {code}{during}")
    if not was_killed(code):
        return WorkerDefect(f"the worker was ended by signal {-code} ({_signal_name(-code)}){during}")
    name = _signal_name(-code)
    if name == "SIGKILL":
        return WorkerKilled(f"the worker was killed{during}, {WHY_KILLED} - {AFTER_KILLED}")
    return WorkerKilled(f"the worker was ended by another program ({name}){during} - run again")


def was_killed(code: int) -> bool:
    """Whether by this exit code somebody else ended the process: the system when memory ran out, a user, a farm."""
    return _signal_name(-code) in _FROM_OUTSIDE


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return "unknown"


def _cancel_once() -> Callable[..., None]:
    """A signal handler that raises `Cancelled` the first time: what is tidied up then must not be cut short."""
    cancelled = False

    def cancel(*_: object) -> None:
        nonlocal cancelled
        if not cancelled:
            cancelled = True
            raise Cancelled

    return cancel


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
    """Events as JSON lines; when their reader has gone, or the disk that they go to is full, the job is cancelled.

    Raises (when called):
        Cancelled: nobody can read any more.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __call__(self, event: Event) -> None:
        try:
            self._stream.write(json.dumps(event) + "\n")
            self._stream.flush()
        except OSError:
            lead_nowhere(self._stream)
            raise Cancelled from None


class BarDisplay:
    """One line that is rewritten on a terminal; elsewhere a line now and then.

    When the stream can no longer be written to, as when the terminal of a job in the background is closed, the job goes
    on and says no more.

    Args:
        stream: where to, usually stderr.
        program: name of the script, said before an error.
        progress: that of the whole job.
        summarise: what to say of a result.
    """

    _QUIET_INTERVAL = 10.0  # seconds between lines when the stream is not a terminal

    def __init__(self, stream: TextIO, program: str, progress: RunProgress, summarise: Callable[[Event], str]) -> None:
        self._stream = stream
        self._program, self._progress, self._summarise = program, progress, summarise
        self._terminal = stream.isatty()
        self._last_line = 0.0
        self._last_stage = ""

    def __call__(self, event: Event) -> None:
        kind = event["event"]
        self._progress.update(event)
        if kind in ("status", "progress"):
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
            write_while_possible(self._stream, "\r" + text[:width].ljust(width))
        elif progress.stage != self._last_stage or time.monotonic() - self._last_line >= self._QUIET_INTERVAL:
            write_while_possible(self._stream, text.rstrip() + "\n")
            self._last_line, self._last_stage = time.monotonic(), progress.stage

    def _say(self, text: str) -> None:
        cleared = "\r" + " " * (shutil.get_terminal_size().columns - 1) + "\r" if self._terminal else ""
        write_while_possible(self._stream, cleared + text + "\n")


def write_while_possible(stream: TextIO, text: str) -> None:
    """Write `text` to `stream` at once; when that fails, whatever is written there from then on goes nowhere."""
    try:
        stream.write(text)
        stream.flush()
    except OSError:
        lead_nowhere(stream)


def lead_nowhere(stream: TextIO) -> None:
    """Let `stream` take what is still to be written, also what Python writes at its end, and show none of it."""
    with open(os.devnull, "w") as nowhere, contextlib.suppress(OSError):  # it may be no file
        os.dup2(nowhere.fileno(), stream.fileno())
