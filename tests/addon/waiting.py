"""Waiting for background jobs where no window runs Blender's timers."""

from __future__ import annotations

import time
from collections.abc import Callable

from cvdgs.cvdgs_addon.activity import ACTIVITY
from cvdgs.cvdgs_addon.background import BackgroundJob

from ..patience import SOON


def until(condition: Callable[[], bool]) -> None:
    """Look at the jobs, as Blender's timer does, until `condition` holds."""
    deadline = time.monotonic() + SOON
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        ACTIVITY.look()
        time.sleep(0.01)


def finished(name: str) -> BackgroundJob:
    """The job of that name, once it has ended."""
    job = ACTIVITY.job(name)
    assert job is not None
    until(lambda: not job.is_running)
    return job
