"""How much Python a piece of work is, counted in calls: the same on every machine, however busy it is.

Seconds are for benchmarks. What a test can hold is their cause: a loop over points, something looked at once for every
pair.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType


def function_calls(work: Callable[[], object]) -> int:
    """Calls of functions, Python's and C's, that `work` makes in this thread; finalisers may come on top."""
    calls = 0

    def count(_frame: FrameType, event: str, _function: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    earlier = sys.getprofile()
    sys.setprofile(count)
    try:
        work()
    finally:
        sys.setprofile(earlier)
    return calls
