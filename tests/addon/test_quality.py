"""Qualities and their time estimates."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.runtime.time_model import TIME_MODEL
from cvdgs.cvdgs_addon.quality import QUALITIES, Quality, expected_seconds, in_words, learned_speeds

SIZES = st.integers(64, 6000)


def reference_seconds(quality: Quality, views: int, width: int, height: int, **options: bool) -> dict[str, float]:
    return TIME_MODEL.stages(quality.iterations, quality.max_size, views, width, height, **options)


@given(st.integers(2, 500), SIZES, SIZES)
def test_finer_takes_longer_and_a_further_layer_takes_less(views, width, height):
    def seconds(quality: Quality, **options: bool) -> float:
        return sum(reference_seconds(quality, views, width, height, **options).values())

    times = [seconds(quality, adds_layer=False) for quality in QUALITIES]
    assert times == sorted(times)
    for quality, whole in zip(QUALITIES, times, strict=True):
        assert seconds(quality, adds_layer=True) < whole < seconds(quality, adds_layer=False, scene_file=True)


@given(st.integers(2, 500), SIZES, SIZES, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_one_run_is_enough_for_the_next_estimate(views, width, height, geometry, rest):
    reference = reference_seconds(QUALITIES[1], views, width, height, adds_layer=False)
    taken = {stage: seconds * (geometry if stage == "geometry" else rest) for stage, seconds in reference.items()}
    learned = learned_speeds({}, reference, taken)
    for stage, seconds in expected_seconds(reference, 3.0, learned).items():
        assert seconds == pytest.approx(taken[stage], rel=0.25, abs=0.5)


def test_a_stage_of_a_moment_teaches_nothing():
    learned = {"capture": 1.0}
    assert learned_speeds(learned, {"capture": 0.04}, {"capture": 0.3}) == learned


def test_a_cancelled_run_teaches_the_stages_that_it_reached():
    reference = reference_seconds(QUALITIES[1], 40, 480, 360, adds_layer=False)
    learned = learned_speeds({}, reference, {"capture": 2.0 * reference["capture"], "unknown": 3.0, "enhance": None})
    expected = expected_seconds(reference, 1.0, learned)
    assert expected["capture"] == pytest.approx(2.0 * reference["capture"])
    assert expected["geometry"] == reference["geometry"]


DRAFT, STANDARD = QUALITIES[0], QUALITIES[1]
WITHIN = 0.2  # of one size, runs differ by a tenth
RECORDED = [
    ((DRAFT, 20, 120, 90, False), (4.8, 3.3, 9.9, 5.3, 1.6, 1.1)),
    ((STANDARD, 20, 120, 90, False), (4.9, 3.8, 10.6, 22.7, 2.0, 1.0)),
    ((DRAFT, 40, 160, 120, False), (3.6, 5.1, 14.4, 14.2, 2.8, 3.9)),
    ((DRAFT, 20, 320, 240, False), (4.1, 10.7, 13.4, 25.5, 9.3, 5.0)),
    ((DRAFT, 40, 240, 180, False), (3.4, 7.0, 13.2, 25.5, 5.4, 5.9)),
    ((DRAFT, 40, 240, 180, True), (3.9, 0.3, 13.6, None, 8.6, 6.3)),
    ((DRAFT, 20, 120, 90, True), (3.9, 0.3, 10.3, None, 2.1, 1.8)),
    ((DRAFT, 20, 320, 240, True), (3.8, 0.2, 13.0, None, 10.4, 4.9)),
]
"""Processor seconds by stage of runs on one machine: what was asked for, and start, capture, enhance, geometry, layers,
and evaluate. Other programs kept that machine busy, so its clock says little."""

STAGES = ("start", "capture", "enhance", "geometry", "layers", "evaluate")


@pytest.mark.parametrize("taught", range(5))
@pytest.mark.parametrize("asked", range(len(RECORDED)))
def test_one_run_teaches_how_long_others_take(taught, asked):
    def recorded(number):
        (quality, views, width, height, adds), taken = RECORDED[number]
        reference = reference_seconds(quality, views, width, height, adds_layer=adds)
        return reference, {stage: seconds for stage, seconds in zip(STAGES, taken, strict=True) if seconds}

    learned = learned_speeds({}, *recorded(taught))
    reference, taken = recorded(asked)
    expected = expected_seconds(reference, 1.0, learned)
    assert sum(expected.values()) == pytest.approx(sum(taken.values()), rel=WITHIN if taught != asked else 1e-6)


@given(st.floats(0.05, 20.0))
def test_the_speed_settles_at_what_runs_show(true_speed):
    speeds: dict[str, float] = {"geometry": 1.0}
    for _ in range(12):
        speeds = learned_speeds(speeds, {"geometry": 300.0}, {"geometry": 300.0 / true_speed})
    assert speeds["geometry"] == pytest.approx(true_speed, rel=1e-2)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(3, "about 10 s"), (42, "about 40 s"), (58, "about 1 min"), (300, "about 5 min"), (6000, "about 1.7 h")],
)
def test_estimates_are_as_rough_as_they_are_sure(seconds, words):
    assert in_words(seconds) == words
