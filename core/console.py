"""Progress of a long function on a terminal: one line a stage, with the time left. Standard library only."""

from __future__ import annotations

import shutil
import time
from typing import TextIO

from .events import Reporter
from .progress import LEAST_SHARE, format_seconds

_QUIET_INTERVAL = 30.0  # seconds between lines when the stream is no terminal
_LIVELY_INTERVAL = 0.2


class ConsoleReporter(Reporter):
    """Rewrites one line on a terminal; elsewhere says something now and then."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._terminal = stream.isatty()
        self._stage, self._started, self._first, self._last = "", 0.0, 0.0, 0.0

    def status(self, stage: str, message: str) -> None:
        self._stream.write(f"{stage}: {message}\n")
        self._stream.flush()

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        now = time.monotonic()
        if stage != self._stage:
            # A resumed stage does not start at 0, so its pace counts from where it was first heard of.
            self._stage, self._started, self._first, self._last = stage, now, fraction, now
        interval = _LIVELY_INTERVAL if self._terminal else _QUIET_INTERVAL
        if now - self._last < interval and fraction < 1.0:
            return
        self._last = now
        done = fraction - self._first
        left = f", {format_seconds((now - self._started) / done * (1.0 - fraction))} left" if done > LEAST_SHARE else ""
        text = f"{stage} {fraction:4.0%}{left}  {message}"
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            self._stream.write("\r" + text[:width].ljust(width) + ("\n" if fraction >= 1.0 else ""))
        else:
            self._stream.write(text.rstrip() + "\n")
        self._stream.flush()

    def warning(self, name: str, message: str) -> None:
        self._stream.write(f"note: {message}\n")
        self._stream.flush()
