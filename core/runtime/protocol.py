"""The worker's protocol: one JSON object a line on stdout. Standard library only: Blender's Python imports this.

    {"event": "status",   "stage": "geometry", "message": "training 10288 Gaussians"}
    {"event": "progress", "stage": "geometry", "fraction": 0.42, "seconds_left": 61.0, "message": "28.1 dB"}
    {"event": "forecast", "seconds": {"geometry": 140.0}}        of the stages on another machine: their ratios count
    {"event": "preview",  "file": "/path/of/a/picture.png"}      only where the request asks for previews
    {"event": "warning",  "name": "few-views", "message": "..."}
    {"event": "error",    "kind": "input" | "defect", "message": "one line"}
    {"event": "result",   ...}       the last line of a job that succeeded

Exit codes: 0 done, 2 unusable input, 130 cancelled, 1 a defect of ours (its traceback goes to stderr, so to the log).
`Reporter` is what every long-running function of `core` takes; the base class is silent.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TextIO

from ..errors import Cancelled, InputError, one_line
from ..files.untrusted import parse_json
from .devices import explain_fault

EXIT_DONE, EXIT_DEFECT, EXIT_INPUT, EXIT_CANCELLED = 0, 1, 2, 130

LEAST_SHARE = 0.02
"""Of some work, done: from less, no time is estimated for the rest."""


class Reporter:
    """Receives what a job has to say. This base class ignores it, which suits tests and library use."""

    def status(self, stage: str, message: str) -> None:
        """A stage begins, or what it does has changed."""

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        """`fraction` of the stage in [0, 1] is done."""

    def warning(self, name: str, message: str) -> None:
        """Something the user should know; `name` is stable for programs."""

    def forecast(self, seconds: Mapping[str, float]) -> None:
        """The stages are likely to take these seconds on a reference machine, so that only their ratios count."""

    def preview(self, file: Path) -> None:
        """`file` is a picture of how far things are, complete; a later one may take its place."""

    def scene(self, gaussians: Callable[[], Any]) -> None:
        """A scene is being fitted from now on: `gaussians` gives its `Gaussians`, in world units, as they are then."""


class StageSpan(Reporter):
    """What a part of a stage reports, as the share of the stage that it is.

    Args:
        inner: receives the stage's progress.
        stage: the stage's name; the part may use another.
        start, end: the fractions of the stage between which the part lies.
        message: said instead of the part's own; None passes that on.
        tells_status: whether what the part begins with is passed on.
        warns: whether warnings are.
    """

    def __init__(
        self,
        inner: Reporter,
        stage: str,
        start: float,
        end: float,
        message: str | None,
        *,
        tells_status: bool = False,
        warns: bool = True,
    ) -> None:
        self._inner, self._stage, self._start, self._end, self._message = inner, stage, start, end, message
        self._tells_status, self._warns = tells_status, warns

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        said = message if self._message is None else self._message
        self._inner.progress(self._stage, self._start + (self._end - self._start) * fraction, said)

    def status(self, stage: str, message: str) -> None:
        if self._tells_status:
            self._inner.status(self._stage, message)

    def warning(self, name: str, message: str) -> None:
        if self._warns:
            self._inner.warning(name, message)

    def scene(self, gaussians: Callable[[], Any]) -> None:
        self._inner.scene(gaussians)


class JsonReporter(Reporter):
    """Writes events as JSON lines; progress at most every `interval` seconds, with the time left of its stage."""

    def __init__(self, stream: TextIO, interval: float = 0.2) -> None:
        self._stream = stream
        self._interval = interval
        self._last = 0.0
        self._stage = ""
        self._stage_started = 0.0
        self._fraction, self._reached = 0.0, 0.0  # of the stage, and when it was first told

    def emit(self, event: str, **fields: Any) -> None:
        """Write one event now."""
        self._stream.write(json.dumps({"event": event, **fields}, allow_nan=False) + "\n")
        self._stream.flush()

    def _enter(self, stage: str) -> None:
        if stage != self._stage:
            self._stage, self._stage_started, self._last = stage, time.monotonic(), 0.0
            self._fraction, self._reached = 0.0, self._stage_started

    def status(self, stage: str, message: str) -> None:
        self._enter(stage)
        self.emit("status", stage=stage, message=message)

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self._enter(stage)
        now = time.monotonic()
        fraction = min(max(float(fraction), 0.0), 1.0)
        if fraction != self._fraction:
            self._fraction, self._reached = fraction, now
        if now - self._last < self._interval and fraction < 1.0:
            return
        self._last = now
        left = self._seconds_left(now)
        self.emit(
            "progress", stage=stage, fraction=round(fraction, 4), seconds_left=left and round(left, 1), message=message
        )

    def _seconds_left(self, now: float) -> float | None:
        """Of the stage by its pace so far; where it stands still they pass, and once they are over nobody knows."""
        elapsed, fraction = self._reached - self._stage_started, self._fraction
        if fraction <= LEAST_SHARE or elapsed <= 0.5:
            return None
        left = elapsed / fraction * (1.0 - fraction) - (now - self._reached)
        return max(left, 0.0) if left > 0.0 or fraction == 1.0 else None

    def warning(self, name: str, message: str) -> None:
        self.emit("warning", name=name, message=message)

    def forecast(self, seconds: Mapping[str, float]) -> None:
        self.emit("forecast", seconds={stage: round(value, 1) for stage, value in seconds.items()})

    def preview(self, file: Path) -> None:
        self.emit("preview", file=str(file))


def do_and_report(work: Callable[[], Mapping[str, Any]], reporter: JsonReporter) -> int:
    """Do `work` and emit its result or its error; returns the exit code.

    Faults of the machine (memory, disk, driver) are explained in one line and count as unusable input.
    """
    try:
        result = work()
    except InputError as error:
        reporter.emit("error", kind="input", message=str(error))
        return EXIT_INPUT
    except Cancelled:
        return EXIT_CANCELLED
    except Exception as error:
        traceback.print_exc()
        explanation = explain_fault(error)
        message = explanation or f"{type(error).__name__}: {error}".splitlines()[0]
        reporter.emit("error", kind="input" if explanation else "defect", message=message)
        return EXIT_INPUT if explanation else EXIT_DEFECT
    reporter.emit("result", **result)
    return EXIT_DONE


# What an event must have, and may have, by its kind. Of a result the kind of job decides.
_REQUIRED: Mapping[str, Mapping[str, tuple[type, ...]]] = {
    "status": {"stage": (str,), "message": (str,)},
    "progress": {"stage": (str,), "fraction": (int, float)},
    "forecast": {"seconds": (dict,)},
    "preview": {"file": (str,)},
    "warning": {"name": (str,), "message": (str,)},
    "error": {"kind": (str,), "message": (str,)},
}
_OPTIONAL = {"message": (str,), "seconds_left": (int, float, type(None))}
_LARGEST_NUMBER = 1e12  # of seconds or a fraction; what is larger need not fit a float
_SHOWN = ("stage", "name", "message")


def parse_event(line: str) -> dict[str, Any] | None:
    """The event that `line` is, with texts that may be shown anywhere, or None.

    None is whatever else a process writes (a library's print, Blender's banner), and what looks like an event but is
    none: not JSON, or without what an event of its kind has.
    """
    if not line.startswith('{"event"'):
        return None
    try:
        event = parse_json(line)
    except ValueError:
        return None
    if event["event"] == "result":
        return event
    required = _REQUIRED.get(event["event"], {}) if isinstance(event["event"], str) else None
    if required is None or not all(name in event for name in required):
        return None
    types = {**_OPTIONAL, **required}
    if not all(_is_usable(event[name], kinds) for name, kinds in types.items() if name in event):
        return None
    shown = {name: one_line(event[name]) for name in _SHOWN if isinstance(event.get(name), str)}
    return {**event, **shown}


def _is_usable(value: Any, kinds: tuple[type, ...]) -> bool:
    if isinstance(value, dict):
        return dict in kinds and all(_is_usable(one, (int, float)) and one >= 0 for one in value.values())
    return isinstance(value, kinds) and not (isinstance(value, int | float) and abs(value) > _LARGEST_NUMBER)


def claim_stdout() -> TextIO:
    """Keep stdout for the protocol: what libraries print, from C++ too, goes to stderr from now on."""
    protocol = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    return protocol
