"""A worker process and how to listen to it, for the command line, the add-on and a farm node. Standard library only.

The worker is a separate process with its own interpreter, because Blender's Python has neither torch nor Warp. It
speaks `protocol` on stdout; whatever else appears there or on stderr goes to the log.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from ..bootstrap import ROOT
from ..errors import Cancelled, InputError
from ..files.untrusted import is_file
from .protocol import parse_event
from .resources import available_processors, processor_quota

WORKER = ROOT / "core" / "__main__.py"
BLENDER_WORKER = ROOT / "cvdgs_addon" / "scene" / "worker.py"
PICTURE_WORKER = ROOT / "cvdgs_addon" / "batch" / "worker.py"

# A worker that is in the middle of a long call into C++ does not see the signal; the user waits no longer than this.
GRACE_SECONDS = 1.2
# What the system cannot end either, because it waits for a disk that has gone, is not waited for.
_KILL_SECONDS = 5.0

Event = dict[str, Any]


def find_python() -> str:
    """The interpreter that has torch and Warp: ``CVDGS_PYTHON``, else the project's environment, else this one.

    Raises:
        InputError: there is none.
    """
    chosen = os.environ.get("CVDGS_PYTHON")
    if chosen:
        if not (is_file(chosen) and os.access(chosen, os.X_OK)):
            raise InputError(
                "is not a program that can be run", where=f"CVDGS_PYTHON={chosen}", remedy="name a Python interpreter"
            )
        return chosen
    if _has_modules("torch", "warp"):
        return sys.executable
    for candidate in (ROOT / ".venv" / "bin" / "python", ROOT / ".venv" / "Scripts" / "python.exe"):
        if os.access(candidate, os.X_OK):
            return str(candidate)
    raise InputError(
        "no Python with torch and Warp found",
        remedy=f"run 'make venv' in {ROOT} (its README says what that needs), or set CVDGS_PYTHON to one that has them",
    )


def blender_command(arguments: list[str], worker: Path = BLENDER_WORKER, threads: int = 0) -> list[str]:
    """The command that runs Blender's side of a job: this Blender, a Python with the bpy wheel, or ``CVDGS_BLENDER``.

    Args:
        arguments: of `worker`.
        worker: the file that Blender runs.
        threads: that a Blender starts, which it has to know before `worker` runs; 0: one for each processor.

    Raises:
        InputError: there is neither, or the Python that was to tell cannot be run.
    """
    limit = ["-t", str(threads)] if threads else []
    in_blender = ["-b", "--factory-startup", *limit, "--python-exit-code", "1", "-P", str(worker), "--", *arguments]
    program = os.environ.get("CVDGS_BLENDER")
    if program:
        return [program, *in_blender]
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.binary_path:
        return [bpy.app.binary_path, *in_blender]
    if _has_modules("bpy"):
        return [sys.executable, str(worker), *arguments]
    python = find_python()
    if _has_bpy(python):
        return [python, str(worker), *arguments]
    raise InputError(
        "no Blender found",
        remedy="set CVDGS_BLENDER to a Blender program, install the bpy wheel, or do without: run.py --no-blend",
    )


def _has_modules(*names: str) -> bool:
    return all(importlib.util.find_spec(name) is not None for name in names)


def _has_bpy(python: str) -> bool:
    program = "import importlib.util, sys; sys.exit(importlib.util.find_spec('bpy') is None)"
    try:
        return subprocess.run([python, "-c", program], env=variables_of_interpreters()).returncode == 0
    except OSError as error:
        raise InputError(f"cannot be run ({error.strerror})", where=python, remedy="check the installation") from None


def variables_of_interpreters() -> dict[str, str]:
    """This process's environment without what Blender sets for its own Python, which would lead another one astray.

    Nor with a studio's own colours, which the variable OCIO names: they need not know those that our pictures have.
    """
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONHOME", "PYTHONPATH", "OCIO")}


class Job:
    """One worker process.

    Args:
        command: program and arguments.
        request: sent to the worker's stdin as one JSON line, if given.
        log: receives every line that the worker writes, stderr included.
        variables: environment variables of the worker, beside this process's.
        grace_seconds: that it has to stop after it was asked to.
        low_priority: give way to other programs, because somebody is working in one meanwhile.

    Attributes:
        cancelled: whether `cancel` was called.
        log_failure: why a line could not be logged, if so.
    """

    def __init__(
        self,
        command: list[str],
        request: Event | None = None,
        log: Callable[[str], None] = lambda _: None,
        variables: Mapping[str, str] = MappingProxyType({}),
        grace_seconds: float = GRACE_SECONDS,
        *,
        low_priority: bool = False,
    ) -> None:
        environment = {**variables_of_interpreters(), **variables}
        environment |= {"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8"}
        # Spinning OpenMP threads make a step 10-15 times slower beside one busy neighbour.
        environment.setdefault("OMP_WAIT_POLICY", "passive")
        if processor_quota() is not None:  # which OpenMP does not look at: it would start a thread for each processor
            environment.setdefault("OMP_NUM_THREADS", str(available_processors()))
        self._log = log
        self._grace_seconds = grace_seconds
        self._queue: queue.Queue[Event | None] = queue.Queue()
        self.cancelled = False
        self.log_failure: OSError | None = None
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=environment,
                start_new_session=True,  # Ctrl-C reaches us, and we decide
                creationflags=LOW_PRIORITY_FLAGS if low_priority else 0,
                text=True,
                encoding="utf-8",
                errors="replace",
            )
        except OSError as error:
            raise InputError(
                f"cannot be started ({error.strerror})", where=command[0], remedy="check the installation"
            ) from None
        if low_priority:
            lower_priority(self._process.pid)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        try:
            if request is not None:
                self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.close()
        except BrokenPipeError:
            pass  # it ended already; its exit code and log say why
        self._threads = [
            threading.Thread(target=self._read_events, args=(self._process.stdout,), daemon=True),
            threading.Thread(target=self._read_log, args=(self._process.stderr,), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def _read_events(self, stream: IO[str]) -> None:
        try:
            for line in stream:
                event = parse_event(line)
                if event is None:
                    self._write_log(line.rstrip())
                else:
                    self._queue.put(event)
        finally:
            self._queue.put(None)  # whatever happens here, nobody waits for ever

    def _read_log(self, stream: IO[str]) -> None:
        for line in stream:
            self._write_log(line.rstrip())

    def _write_log(self, line: str) -> None:
        """Log a line. Where that fails (a full disk), reading continues, or the worker would wait for ever to write."""
        try:
            self._log(line)
        except OSError as error:
            self.log_failure = self.log_failure or error
        except ValueError:
            pass  # the log was closed, because nobody follows the worker any more

    def events(
        self, patience_seconds: float | None = None, on_silence: Callable[[], None] = lambda: None
    ) -> Iterator[Event]:
        """The worker's events until it ends.

        Args:
            patience_seconds: None waits without a word.
            on_silence: called each time that nothing was heard for so long.
        """
        while True:
            try:
                event = self._queue.get(timeout=patience_seconds)
            except queue.Empty:
                on_silence()
                continue
            if event is None:
                return
            yield event

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def wait(self) -> int:
        """Wait for the end; returns the exit code (negative: the signal that ended it)."""
        code = self._process.wait()
        for thread in self._threads:
            thread.join(timeout=5.0)
        return code

    def cancel(self) -> None:
        """Ask the worker to stop, and end it and its children when it does not within the grace period."""
        self.cancelled = True
        self._signal(signal.SIGINT)
        deadline = time.monotonic() + self._grace_seconds
        while self.running and time.monotonic() < deadline:
            time.sleep(0.02)
        self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_KILL_SECONDS)

    def _signal(self, number: int) -> None:
        try:
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, number)
            elif self.running:
                self._process.terminate()
        except (ProcessLookupError, PermissionError):
            pass  # it has ended


class Workers:
    """Starts the workers of one piece of work, one after the other, and cancels them from any thread.

    Args:
        python: interpreter that has torch and Warp; None looks for one when it is needed (`find_python`).
        variables: environment variables of the workers, beside this process's.
        low_priority: workers give way to other programs, because somebody is working in one meanwhile.
    """

    def __init__(
        self,
        python: str | None = None,
        variables: Mapping[str, str] = MappingProxyType({}),
        *,
        low_priority: bool = False,
    ) -> None:
        self._python = python
        self._low_priority = low_priority
        self._variables = dict(variables)
        self._lock = threading.Lock()
        self._current: Job | None = None
        self._cancelled = False

    def start(self, request: Event, log: Callable[[str], None] = lambda _: None) -> Job:
        """A worker of `core` that does `request`.

        Raises:
            InputError: there is no interpreter for it, or it cannot be started.
            Cancelled: `cancel` was called.
        """
        return self.start_command([self.require_python(), str(WORKER)], request, log)

    def start_page(self, request: Event, log: Callable[[str], None] = lambda _: None) -> Job:
        """As `start`, for a job that needs no more than Jinja2 and numpy: by this very Python where that has them."""
        python = sys.executable if _has_modules("jinja2", "numpy") else self.require_python()
        return self.start_command([python, str(WORKER)], request, log)

    def start_command(
        self, command: list[str], request: Event | None = None, log: Callable[[str], None] = lambda _: None
    ) -> Job:
        """Another program that speaks the protocol; errors as for `start`."""
        with self._lock:
            if self._cancelled:
                raise Cancelled
            self._current = Job(command, request, log, self._variables, low_priority=self._low_priority)
            return self._current

    def require_python(self) -> str:
        """The interpreter; raises `InputError` when there is none."""
        if self._python is None:
            self._python = find_python()
        return self._python

    def cancel(self) -> None:
        """End the current worker and start no other. Returns at once; whoever follows the worker meets `Cancelled`."""
        with self._lock:
            self._cancelled = True
            if self._current is not None:
                threading.Thread(target=self._current.cancel, name="cancel", daemon=True).start()


_NICENESS = 5  # a third of an equal share: enough for smooth drawing, and no standstill beside other programs

LOW_PRIORITY_FLAGS = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
"""Creation flags of a process of low priority on Windows; none elsewhere."""


def lower_priority(process: int) -> None:
    """Let a process that has just started, and what it will start, give way to other programs.

    Linux shares the processor between sessions first and applies niceness only within one, so both are set. What the
    system does not support or allow is left as it is.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, process, _NICENESS)
    with contextlib.suppress(OSError):
        Path(f"/proc/{process}/autogroup").write_text(str(_NICENESS), encoding="ascii")


_CHECK_SECONDS = 0.5


def follow_parent(when_gone: Callable[[], None], parent: int | None = None) -> None:
    """Watch from a thread, and call `when_gone` there once the process that started this one has ended.

    A killed process cannot say so itself; one that outlives it keeps the machine busy and writes where a new run does.
    Windows does not tell.

    Args:
        when_gone: is to end this process.
        parent: number of the process that started this one, where it may have ended already; None asks the system.
    """
    if sys.platform == "win32":  # the number stays, and that of an environment's python.exe, which starts another one
        return
    expected = os.getppid() if parent is None else parent

    def watch() -> None:
        while os.getppid() == expected:
            time.sleep(_CHECK_SECONDS)
        when_gone()

    threading.Thread(target=watch, name="follow parent", daemon=True).start()
