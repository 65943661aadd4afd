"""A process that does one piece of Blender's work, whoever started it. Imports bpy only through the work itself.

Speaks the protocol of ``core/runtime/protocol.py`` on stdout; what Blender prints goes to stderr. Exit codes: 0 done,
2 unusable input or arguments, 130 cancelled by SIGINT or SIGTERM, 1 a defect of ours.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from ..core.runtime.process import follow_parent
from ..core.runtime.protocol import EXIT_CANCELLED, JsonReporter, Reporter, claim_stdout, do_and_report

_THREADS_OF_THIS_PROCESS = Path("/proc/self/task")
_ENDING = threading.Lock()  # held from the first call that ends the process
Request = TypeVar("Request")


@contextmanager
def limit_cpu_affinity(processors: int) -> Iterator[None]:
    """Let libraries that are loaded meanwhile find so many processors; 0 leaves them all.

    Blender's task scheduler (TBB) starts a thread for each processor that the process may use when it is loaded, and
    one that finds nothing to do while Cycles renders with fewer threads asks for work without end: a render with one
    thread kept both cores of a machine busy. ``blender -t`` would say how many, but the bpy module has no arguments.
    Where the system cannot restrict a process (Windows, macOS) nothing happens.
    """
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    if not 0 < processors < len(allowed):
        yield
        return
    os.sched_setaffinity(0, set(sorted(allowed)[:processors]))
    try:
        yield
    finally:
        # Threads that were started meanwhile have taken over the restriction.
        for thread in _THREADS_OF_THIS_PROCESS.iterdir():
            with suppress(ProcessLookupError):  # it has ended by now
                os.sched_setaffinity(int(thread.name), allowed)


def serve(
    read: Callable[[], Request],
    work: Callable[[Request, Reporter], Mapping[str, Any]],
    clean_up: Callable[[Request], None],
) -> NoReturn:
    """Do what is asked for, report, and end the process.

    Args:
        read: says what is asked for.
        work: does it and returns the fields of the result; imports bpy, which takes a second, only now.
        clean_up: removes what `work` leaves half-written when it is cancelled; called from another thread.
    """
    reporter = JsonReporter(claim_stdout())

    def do() -> Mapping[str, Any]:
        request = read()
        _end_on_signal(lambda: clean_up(request))
        follow_parent(lambda: _clean_up_and_end(lambda: clean_up(request)))
        return work(request, reporter)

    _end(do_and_report(do, reporter))


def _end_on_signal(clean_up: Callable[[], None]) -> None:
    """End the process within moments of SIGINT or SIGTERM, leaving nothing half-written.

    Blender renders in one long call during which Python's signal handlers cannot run on the main thread; a thread that
    Python wakes from the C handler can.
    """
    receiver, sender = socket.socketpair()
    sender.setblocking(False)

    def watch() -> None:
        receiver.recv(1)
        _clean_up_and_end(clean_up)

    threading.Thread(target=watch, name="cancel", daemon=True).start()
    signal.set_wakeup_fd(sender.detach())
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)


def _clean_up_and_end(clean_up: Callable[[], None]) -> NoReturn:
    _end(EXIT_CANCELLED, clean_up)


def _end(code: int, clean_up: Callable[[], None] = lambda: None) -> NoReturn:
    """End at once, because Blender 4.5 can hang in its own clean-up; what that would have removed is removed here.

    Until the process has ended, another thread may still write: `clean_up` comes last, and once more when nothing can
    be opened any longer. Whoever asks first says with which code the process ends.
    """
    if not _ENDING.acquire(blocking=False):
        threading.Event().wait()
    bpy = sys.modules.get("bpy")
    if bpy is not None and getattr(bpy, "app", None) is not None:
        shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    clean_up()
    _forbid_opening_files()
    clean_up()
    os._exit(code)


def _forbid_opening_files() -> None:
    """Let no thread of this process open or make a file any more, where the system can say so (not Windows)."""
    try:
        import resource
    except ImportError:
        return
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, most))
