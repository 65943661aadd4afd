"""A long function tells a terminal how far it is, and the time left once there is something to go by."""

import io
from types import SimpleNamespace

from cvdgs.core.runtime import cli as console
from cvdgs.core.runtime.cli import ConsoleReporter


def shown(monkeypatch, *heard: tuple[float, float]) -> list[str]:
    """The lines that a log gets of fractions heard at so many seconds."""
    now = [0.0]
    monkeypatch.setattr(console, "_QUIET_INTERVAL", 0.0)
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: now[0]))
    stream = io.StringIO()
    reporter = ConsoleReporter(stream)
    for now[0], fraction in heard:
        reporter.progress("environment", fraction, "looking for torch")
    return stream.getvalue().splitlines()


def test_a_first_hundredth_says_nothing_about_the_rest(monkeypatch):
    assert shown(monkeypatch, (0.0, 0.05), (1.0, 0.06)) == [
        "environment   5%  looking for torch",
        "environment   6%  looking for torch",
    ]


def test_the_time_left_follows_from_the_pace(monkeypatch):
    assert shown(monkeypatch, (0.0, 0.0), (10.0, 0.25))[1] == "environment  25%, 0:30 left  looking for torch"


def test_a_stage_that_begins_once_more_has_a_pace_of_its_own(monkeypatch):
    heard = shown(monkeypatch, (0.0, 0.0), (600.0, 1.0), (600.0, 0.0), (610.0, 0.25))
    assert heard[-1] == "environment  25%, 0:30 left  looking for torch"
