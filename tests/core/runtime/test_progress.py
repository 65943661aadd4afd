"""The bar of the whole run: it only moves forward, and its estimate ends at nothing."""

from types import SimpleNamespace

import pytest

from cvdgs.core.runtime import progress
from cvdgs.core.runtime.progress import CAMERAS, RunProgress, format_seconds

STAGES = ("start", "capture", "geometry", "enhance", "layers", "evaluate", "blender")


def test_the_fraction_rises_from_stage_to_stage_and_ends_at_one():
    run = RunProgress(STAGES)
    seen = []
    for stage in STAGES:
        for fraction in (0.0, 0.5, 1.0):
            run.update({"event": "progress", "stage": stage, "fraction": fraction, "seconds_left": 1.0})
            seen.append(run.fraction)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


def test_the_stages_own_estimate_counts_and_later_stages_add_to_it():
    run = RunProgress(STAGES)
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.5, "seconds_left": 30.0})
    assert run.seconds_left >= 29.0
    run.update({"event": "progress", "stage": "blender", "fraction": 1.0, "seconds_left": 0.0})
    assert run.seconds_left in (None, 0.0)


class Clock:
    """Stands still until it is told."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=clock))
    return clock


@pytest.mark.parametrize("loading", [0.5, 60.0])
def test_the_time_that_loading_takes_does_not_count_for_the_rest(clock, loading):
    run = RunProgress(("start", "geometry"), expected={"start": 0.02, "geometry": 0.98})
    run.update({"event": "status", "stage": "start", "message": "loading"})
    clock.now += loading
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.0})
    assert run.seconds_left is None
    clock.now += 30.0
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.5})
    assert run.seconds_left == pytest.approx(30.0)


def test_the_time_of_a_stage_that_was_not_expected_does_not_count_for_the_rest(clock):
    run = RunProgress(("capture", "geometry"), expected={"capture": 0.25, "geometry": 0.75})
    run.update({"event": "status", "stage": "capture"})
    clock.now += 5.0
    run.update({"event": "status", "stage": "lens"})
    clock.now += 500.0
    run.update({"event": "status", "stage": "capture"})
    clock.now += 5.0
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.0})
    assert run.seconds_left == pytest.approx(30.0)


def test_what_a_stage_that_was_not_expected_still_takes_comes_on_top_of_the_rest(clock):
    run = RunProgress(("capture", "geometry"), expected={"capture": 10.0, "geometry": 30.0})
    run.update({"event": "progress", "stage": "capture", "fraction": 0.0})
    clock.now += 10.0
    run.update({"event": "progress", "stage": "capture", "fraction": 1.0})
    run.update({"event": "progress", "stage": "lens", "fraction": 0.1, "seconds_left": 90.0})
    assert run.seconds_left == pytest.approx(120.0)
    clock.now += 80.0
    assert run.seconds_left == pytest.approx(40.0)


def test_before_the_pace_is_known_the_stages_own_estimate_says_how_long_the_rest_takes(clock):
    run = RunProgress(("geometry", "evaluate"), expected={"geometry": 0.5, "evaluate": 0.5})
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.01, "seconds_left": 99.0})
    assert run.seconds_left == pytest.approx(199.0)


def test_the_estimate_of_a_small_stage_says_nothing_of_the_rest(clock):
    run = RunProgress(("capture", "geometry"), expected={"capture": 0.01, "geometry": 0.99})
    run.update({"event": "progress", "stage": "capture", "fraction": 0.1, "seconds_left": 9.0})
    assert run.seconds_left is None


def test_events_of_other_kinds_change_nothing():
    run = RunProgress(STAGES)
    run.update({"event": "warning", "name": "x", "message": "y"})
    assert (run.stage, run.fraction, run.seconds_left) == ("", 0.0, None)


def test_a_stage_that_was_not_expected_does_not_move_the_bar():
    run = RunProgress(STAGES)
    run.update({"event": "progress", "stage": "capture", "fraction": 1.0, "seconds_left": 0.0})
    reached = run.fraction
    run.update({"event": "progress", "stage": "lens", "fraction": 0.9, "seconds_left": 5.0})
    assert run.fraction == reached


def test_what_the_worker_forecasts_for_its_capture_tells_how_long_the_rest_takes(clock):
    run = RunProgress(("capture", "enhance", "geometry"))
    run.update({"event": "status", "stage": "capture"})
    clock.now += 1.0
    run.update({"event": "forecast", "seconds": {"capture": 10.0, "enhance": 100.0, "geometry": 200.0}})
    run.update({"event": "progress", "stage": "enhance", "fraction": 0.0})
    clock.now += 10.0
    run.update({"event": "progress", "stage": "enhance", "fraction": 1.0})
    assert run.fraction == pytest.approx(110 / 310)
    assert run.seconds_left == pytest.approx(20.0)


@pytest.mark.parametrize("expected", [None, {"capture": 10.0, "geometry": 30.0}])
def test_the_bar_moves_while_cameras_are_estimated_once_it_is_forecast_how_long_that_takes(clock, expected):
    run = RunProgress(("capture", CAMERAS, "geometry"), expected=expected)
    run.update({"event": "forecast", "seconds": {"capture": 10.0, "geometry": 30.0}})
    run.update({"event": "progress", "stage": "capture", "fraction": 0.0})
    clock.now += 10.0
    run.update({"event": "progress", "stage": "capture", "fraction": 1.0})
    run.update({"event": "forecast", "seconds": {CAMERAS: 60.0}})
    run.update({"event": "progress", "stage": CAMERAS, "fraction": 0.0})
    clock.now += 30.0
    run.update({"event": "progress", "stage": CAMERAS, "fraction": 0.5, "seconds_left": 30.0})
    assert run.fraction == pytest.approx(0.4)
    assert run.seconds_left == pytest.approx(60.0)
    clock.now += 30.0
    run.update({"event": "progress", "stage": CAMERAS, "fraction": 1.0, "seconds_left": 0.0})
    run.update({"event": "progress", "stage": "capture", "fraction": 1.0, "seconds_left": 0.0})
    assert run.fraction == pytest.approx(0.7)
    assert run.seconds_left == pytest.approx(30.0)


def test_a_stage_of_which_nobody_knows_how_long_it_takes_does_not_count_for_the_rest(clock):
    run = RunProgress(("capture", CAMERAS, "geometry"), expected={"capture": 10.0, "geometry": 30.0})
    run.update({"event": "progress", "stage": CAMERAS, "fraction": 0.0})
    clock.now += 500.0
    run.update({"event": "progress", "stage": "capture", "fraction": 0.0})
    clock.now += 10.0
    run.update({"event": "progress", "stage": "capture", "fraction": 1.0})
    assert run.seconds_left == pytest.approx(30.0)


def test_a_forecast_changes_nothing_where_more_is_known_of_the_machine():
    run = RunProgress(("enhance", "geometry"), expected={"enhance": 1.0, "geometry": 3.0})
    run.update({"event": "forecast", "seconds": {"enhance": 3.0, "geometry": 1.0}})
    run.update({"event": "progress", "stage": "enhance", "fraction": 1.0})
    assert run.fraction == pytest.approx(0.25)


def test_a_forecast_does_not_move_the_bar_back():
    run = RunProgress(("capture", "geometry"))
    run.update({"event": "progress", "stage": "capture", "fraction": 1.0})
    reached = run.fraction
    run.update({"event": "forecast", "seconds": {"capture": 1.0, "geometry": 10_000.0}})
    assert run.fraction == reached


def test_times_are_written_for_people():
    assert [format_seconds(s) for s in (0.4, 59.6, 61, 3725)] == ["0:00", "1:00", "1:01", "1:02:05"]


def test_another_job_brings_the_shares_of_its_own_stages():
    run = RunProgress(("read", "enhance"), expected={"read": 1.0, "enhance": 3.0})
    run.update({"event": "progress", "stage": "enhance", "fraction": 0.5, "seconds_left": 1.0})
    assert run.fraction == pytest.approx(0.625)


def test_the_seconds_of_stages_are_known_as_far_as_they_were_reached(clock):
    run = RunProgress(("capture", "geometry", "layers"))
    run.update({"event": "status", "stage": "capture", "message": "reading"})
    clock.now += 4.0
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.0})
    clock.now += 30.0
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.1})
    assert run.stage_seconds() == {"capture": pytest.approx(4.0)}
    clock.now += 30.0
    run.update({"event": "progress", "stage": "geometry", "fraction": 0.5})
    assert run.stage_seconds() == {"capture": pytest.approx(4.0), "geometry": pytest.approx(120.0)}


def test_what_belongs_to_a_stage_counts_for_it_and_compiling_for_none(clock):
    run = RunProgress(("start", "capture", "geometry"))
    for stage, seconds in (("start", 3.0), ("capture", 1.0), ("kernels", 60.0), ("lens", 4.0)):
        run.update({"event": "status", "stage": stage})
        clock.now += seconds
    assert run.stage_seconds() == {"start": pytest.approx(3.0), "kernels": pytest.approx(60.0)}
    run.update({"event": "status", "stage": "geometry"})
    assert run.stage_seconds()["capture"] == pytest.approx(5.0)
