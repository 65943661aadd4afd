"""A long function tells a terminal how far it is, and the time left once there is something to go by."""

import io

from cvdgs.core.runtime import cli as console
from cvdgs.core.runtime.cli import ConsoleReporter


def shown(monkeypatch, *fractions: float) -> list[str]:
    """The lines that a log gets."""
    monkeypatch.setattr(console, "_QUIET_INTERVAL", 0.0)
    stream = io.StringIO()
    reporter = ConsoleReporter(stream)
    for fraction in fractions:
        reporter.progress("environment", fraction, "looking for torch")
    return stream.getvalue().splitlines()


def test_a_first_hundredth_says_nothing_about_the_rest(monkeypatch):
    assert shown(monkeypatch, 0.05, 0.06) == [
        "environment   5%  looking for torch",
        "environment   6%  looking for torch",
    ]


def test_the_time_left_follows_from_the_pace(monkeypatch):
    assert shown(monkeypatch, 0.05, 0.15)[1] == "environment  15%, 0:00 left  looking for torch"
