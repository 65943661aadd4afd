"""How many threads Blender starts when it is loaded as a module. Standard library only."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_THREADS_OF_THIS_PROCESS = Path("/proc/self/task")


@contextmanager
def as_if_on(processors: int) -> Iterator[None]:
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
