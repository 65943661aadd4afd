"""The bar of the whole run: it only moves forward, and its estimate ends at nothing."""

import pytest

from cvdgs.core.progress import RunProgress, format_seconds

STAGES = ("start", "capture", "geometry", "enhance", "layers", "evaluate", "blender")


def test_the_fraction_rises_from_stage_to_stage_and_ends_at_one():
    progress = RunProgress(STAGES)
    seen = []
    for stage in STAGES:
        for fraction in (0.0, 0.5, 1.0):
            progress.update({"event": "progress", "stage": stage, "fraction": fraction, "seconds_left": 1.0})
            seen.append(progress.fraction)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


def test_the_stages_own_estimate_counts_and_later_stages_add_to_it():
    progress = RunProgress(STAGES)
    progress.update({"event": "progress", "stage": "geometry", "fraction": 0.5, "seconds_left": 30.0})
    assert progress.seconds_left >= 29.0
    progress.update({"event": "progress", "stage": "blender", "fraction": 1.0, "seconds_left": 0.0})
    assert progress.seconds_left in (None, 0.0)


def test_events_of_other_kinds_change_nothing():
    progress = RunProgress(STAGES)
    progress.update({"event": "warning", "name": "x", "message": "y"})
    assert (progress.stage, progress.fraction, progress.seconds_left) == ("", 0.0, None)


def test_a_stage_that_was_not_expected_does_not_move_the_bar():
    progress = RunProgress(STAGES)
    progress.update({"event": "progress", "stage": "capture", "fraction": 1.0, "seconds_left": 0.0})
    reached = progress.fraction
    progress.update({"event": "progress", "stage": "sfm", "fraction": 0.9, "seconds_left": 5.0})
    assert progress.fraction == reached


def test_times_are_written_for_people():
    assert [format_seconds(s) for s in (0.4, 59.6, 61, 3725)] == ["0:00", "1:00", "1:01", "1:02:05"]


def test_another_job_brings_the_shares_of_its_own_stages():
    progress = RunProgress(("read", "enhance"), shares={"read": 1.0, "enhance": 3.0})
    progress.update({"event": "progress", "stage": "enhance", "fraction": 0.5, "seconds_left": 1.0})
    assert progress.fraction == pytest.approx(0.625)
