"""Lets the program that somebody works in go before the workers that it starts. Standard library only."""

from __future__ import annotations

import contextlib
import os
import subprocess
from pathlib import Path

_NICENESS = 5  # a third of what an equal would get: enough for smooth drawing, and no standstill beside others

BEHIND_FLAGS = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
"""Creation flags of a process that goes behind others, on Windows; elsewhere none."""


def put_behind(process: int) -> None:
    """Let other programs go before a process that has just started, and before what it will start.

    Linux shares the processor between sessions first, and only within one by niceness; so both are told. What the
    system does not know or allow is left as it is.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, process, _NICENESS)
    with contextlib.suppress(OSError):
        Path(f"/proc/{process}/autogroup").write_text(str(_NICENESS), encoding="ascii")
