"""From a stage's events to one bar with the time left of the whole run. Standard library only."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from .process import Event
from .protocol import LEAST_SHARE
from .time_model import TIME_MODEL

COMPILING = "kernels"
"""What a machine does once, before its first run."""

CAMERAS = "cameras"
"""Estimating those that did not come with the photographs; how long that takes is forecast as it begins."""

STARTING = "start"
"""The stage before the work: interpreters start and libraries load. How long that takes says little about the rest."""

_LEAST_SECONDS = 2.0  # that an estimate is made from at least
_TELLING_SHARE = 0.5  # of a stage, from which its whole time is concluded; parts of one differ in pace

# Seconds of each stage with the embedded demo on the reference machine. Only their ratios count, and only for the
# estimate of the time left, which corrects itself during the run.
STAGE_SECONDS = {
    **TIME_MODEL.stages(3000, 640, 40, 640, 480, adds_layer=False, scene_file=True),
    "turntable": 100.0,  # of 48 pictures in two layers; goes by their number
}


@dataclass
class RunProgress:
    """Follows the events of a run.

    Attributes:
        stages: the stages that this run has, in order.
        stage: the one that it is in.
        message: what it last said.
        expected: seconds by stage, of which the ratios count; of those that are not there, and of all with None, what
            the worker forecasts counts, once it does.
    """

    stages: tuple[str, ...]
    stage: str = ""
    message: str = ""
    expected: Mapping[str, float] | None = None
    _forecast: dict[str, float] = field(default_factory=dict)
    _seconds: dict[str, float] = field(default_factory=dict)
    _latest_of_run: str = ""
    _counts_for: str = ""
    _fraction: float = 0.0
    _reached: float = 0.0
    _stage_seconds_left: float | None = None
    _worked: float = 0.0
    _updated: float = 0.0

    def update(self, event: Event) -> None:
        """Take in a status, progress or forecast event; others are ignored."""
        if event.get("event") == "forecast":
            self._forecast |= event["seconds"]
        if event.get("event") not in ("status", "progress"):
            return
        now = time.monotonic()
        if self.stage:
            self._seconds[self._counts_for] = self._seconds.get(self._counts_for, 0.0) + now - self._updated
        self._worked, self._updated = self._seconds_worked, now
        if event.get("stage") != self.stage:
            self.stage, self._fraction, self._stage_seconds_left = str(event.get("stage")), 0.0, None
            if self.stage in self.stages:
                self._latest_of_run = self.stage
            self._counts_for = COMPILING if self.stage == COMPILING else self._latest_of_run or self.stage
        self.message = str(event.get("message") or self.message)
        if event["event"] == "progress":
            self._fraction = float(event["fraction"])
            self._stage_seconds_left = event.get("seconds_left")
        self._reach()

    def stage_seconds(self) -> dict[str, float]:
        """Of the stages that were left, and of the present one, what it will have taken, where that can be told.

        A stage that was not expected is part of the one before it, but for `COMPILING`.
        """
        known = {stage: seconds for stage, seconds in self._seconds.items() if stage != self._counts_for}
        if self._fraction >= _TELLING_SHARE and self.stage in self._seconds:
            known[self.stage] = self._seconds[self.stage] / self._fraction
        return known

    @property
    def fraction(self) -> float:
        """Of the whole run, in [0, 1]; it stands still in a stage that was not expected."""
        self._reach()
        return self._reached

    def _reach(self) -> None:
        if self.stage in self.stages:
            before = self._share_of(self.stages[: self.stages.index(self.stage)])
            here = self._share_of((self.stage,)) * self._fraction
            self._reached = max(self._reached, min(before + here, 1.0))

    @property
    def seconds_left(self) -> float | None:
        """Of the whole run: the stage's own estimate, and its pace for what follows. None while nothing is known.

        What a stage that was not expected still takes, such as checking cameras, comes on top of what was.
        """
        done = self.fraction - self._share_of((STARTING,))
        worked = self._seconds_worked
        pace = worked / done if done > LEAST_SHARE and worked > _LEAST_SECONDS else None
        overall = None if pace is None else pace * (1.0 - self.fraction)
        if self._stage_seconds_left is None:
            return overall
        in_stage = max(self._stage_seconds_left - (time.monotonic() - self._updated), 0.0)
        if self.stage not in self.stages:
            return None if overall is None else overall + in_stage
        share = self._share_of((self.stage,)) * (1.0 - self._fraction)
        if share <= LEAST_SHARE and pace is None:
            return None
        # Where cameras are estimated, reading the capture goes on after that.
        later = min(self._share_of(self.stages[self.stages.index(self.stage) + 1 :]), 1.0 - self.fraction)
        return in_stage + (in_stage / share if pace is None else pace) * later

    @property
    def _seconds_worked(self) -> float:
        """Time in the stages whose shares are known, from which the pace is taken."""
        working = self.stage != STARTING and self._share_of((self.stage,)) > 0.0
        return self._worked + (time.monotonic() - self._updated if working else 0.0)

    def _share_of(self, stages: tuple[str, ...]) -> float:
        """Of the run's time, in [0, 1]."""
        seconds = {**STAGE_SECONDS, **self._forecast} if self.expected is None else {**self._forecast, **self.expected}
        total = sum(seconds.get(name, 0.0) for name in self.stages) or 1.0
        return sum(seconds.get(name, 0.0) for name in stages if name in self.stages) / total


class Clock:
    """Times the stages of a piece of work.

    Attributes:
        seconds: of each stage, rounded to hundredths.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float | None] = {}
        self._started = self._last = time.perf_counter()

    @property
    def total(self) -> float:
        """Seconds since the clock was made."""
        return round(time.perf_counter() - self._started, 2)

    def lap(self, stage: str) -> None:
        """The time since the last lap, or since the clock was made, was spent on `stage`."""
        last, self._last = self._last, time.perf_counter()
        self.seconds[stage] = round(self._last - last, 2)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Time the block as `stage`, or as more of it."""
        started = time.perf_counter()
        yield
        self.seconds[stage] = round((self.seconds.get(stage) or 0.0) + time.perf_counter() - started, 2)


def format_seconds(seconds: float) -> str:
    """``m:ss`` or ``h:mm:ss``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
