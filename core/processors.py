"""How many processors this process may use. Standard library only."""

from __future__ import annotations

import os


def available_processors() -> int:
    """At least one; fewer than the machine has where the process is confined to some of them."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
