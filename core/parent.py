"""Lets a process end when the one that started it has gone. Standard library only: Blender's Python imports this."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

_CHECK_SECONDS = 0.5


def follow_parent(when_gone: Callable[[], None], parent: int | None = None) -> None:
    """Watch from a thread, and call `when_gone` there once the process that started this one has ended.

    Killed, it cannot say so itself; what goes on without it keeps the machine busy and writes where a new run does.

    Args:
        when_gone: is to end this process.
        parent: number of the process that started this one, where it may have ended already; None asks the system.
    """
    expected = os.getppid() if parent is None else parent

    def watch() -> None:
        while os.getppid() == expected:
            time.sleep(_CHECK_SECONDS)
        when_gone()

    threading.Thread(target=watch, name="follow parent", daemon=True).start()
