"""The doctor's whole round. Standard library only."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator

from ..events import Reporter
from .blender import examine_blender
from .computer import examine_computer
from .finding import Finding, State
from .worker import examine_worker

STAGE = "doctor"


def examine(reporter: Reporter | None = None) -> Iterator[Finding]:
    """Every finding as it is made; some seconds, because packages are imported to see whether they work."""
    tell = (reporter or Reporter()).status
    tell(STAGE, "asking the worker's Python")
    worker = list(examine_worker())
    yield Finding("this Python", State.OK, f"{platform.python_version()} ({sys.executable})")
    yield from worker
    tell(STAGE, "asking Blender")
    worker_is_here = worker[0].state is State.OK
    yield from examine_blender(worker_is_here=worker_is_here)
    yield from examine_computer(environment_is_here=worker_is_here)
