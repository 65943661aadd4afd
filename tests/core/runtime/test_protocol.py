"""What a worker tells of its progress, and what is taken from it."""

from __future__ import annotations

import io
import json
from types import SimpleNamespace

import pytest

from cvdgs.core.runtime import protocol
from cvdgs.core.runtime.protocol import JsonReporter, Reporter, StageSpan, parse_event


def events_of(stream: io.StringIO) -> list[dict]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def seconds_left(monkeypatch, *steps: tuple[float, float]) -> list[float | None]:
    """What is told at each of the `steps` of a stage: seconds since it began, and the fraction that is done."""
    now = [0.0]
    monkeypatch.setattr(protocol, "time", SimpleNamespace(monotonic=lambda: now[0]))
    stream = io.StringIO()
    reporter = JsonReporter(stream)
    reporter.status("layers", "fitting")
    for now[0], fraction in steps:
        reporter.progress("layers", fraction)
    return [event["seconds_left"] for event in events_of(stream)[1:]]


def test_no_time_is_estimated_from_the_first_steps_after_a_long_preparation(monkeypatch):
    assert seconds_left(monkeypatch, (25.0, 0.001), (26.0, 0.01), (30.0, 0.5)) == [None, None, 30.0]


def test_where_a_stage_stands_still_its_time_passes_until_nobody_knows(monkeypatch):
    steps = ((10.0, 0.5), (14.0, 0.5), (21.0, 0.5), (30.0, 0.75), (40.0, 1.0))
    assert seconds_left(monkeypatch, *steps) == [10.0, 6.0, None, 10.0, 0.0]


def test_a_forecast_is_heard_as_it_was_said():
    stream = io.StringIO()
    JsonReporter(stream).forecast({"enhance": 12.34, "geometry": 200.0})
    assert parse_event(stream.getvalue()) == {"event": "forecast", "seconds": {"enhance": 12.3, "geometry": 200.0}}


@pytest.mark.parametrize("seconds", ["12", '{"geometry": "12"}', '{"geometry": -1}', '{"geometry": 1e300}', "[1]"])
def test_a_forecast_of_anything_but_seconds_is_none(seconds):
    assert parse_event(f'{{"event": "forecast", "seconds": {seconds}}}') is None


@pytest.mark.parametrize(("message", "said"), [(None, "28.1 dB"), ("training", "training")])
def test_a_part_of_a_stage_says_its_own_or_what_the_stage_says(message, said):
    heard = []

    class Ears(Reporter):
        def progress(self, stage: str, fraction: float, message: str = "") -> None:
            heard.append((stage, fraction, message))

    StageSpan(Ears(), "geometry", 0.5, 0.9, message).progress("training", 0.5, "28.1 dB")
    assert heard == [("geometry", pytest.approx(0.7), said)]


@pytest.mark.parametrize("warns", [True, False])
def test_a_part_of_a_stage_warns_unless_it_is_told_not_to(warns):
    heard = []

    class Ears(Reporter):
        def warning(self, name: str, message: str) -> None:
            heard.append(name)

    StageSpan(Ears(), "geometry", 0.0, 1.0, None, warns=warns).warning("motion-blur-corrected", "they were smeared")
    assert heard == ["motion-blur-corrected"] * warns
