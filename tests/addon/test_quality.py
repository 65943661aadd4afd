"""Qualities and their time estimates."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.cvdgs_addon.quality import QUALITIES, TIME_MODEL, Quality, in_words, learned_speed

SIZES = st.integers(64, 6000)


@given(st.integers(2, 500), SIZES, SIZES)
def test_finer_takes_longer_and_a_further_layer_takes_less(views, width, height):
    def seconds(quality: Quality, **options: bool) -> float:
        return sum(TIME_MODEL.stages(quality, views, width, height, **options).values())

    times = [seconds(quality, adds_layer=False) for quality in QUALITIES]
    assert times == sorted(times)
    for quality, whole in zip(QUALITIES, times, strict=True):
        assert seconds(quality, adds_layer=True) < whole < seconds(quality, adds_layer=False, scene_file=True)


@given(st.floats(0.05, 20.0), st.floats(5.0, 5000.0))
def test_the_speed_settles_at_what_runs_show(true_speed, expected):
    speed = 0.0
    for _ in range(12):
        speed = learned_speed(speed, expected, max(expected / true_speed, 1.0))
    assert speed == pytest.approx(min(true_speed, expected), rel=1e-3)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(3, "about 10 s"), (42, "about 40 s"), (58, "about 1 min"), (300, "about 5 min"), (6000, "about 1.7 h")],
)
def test_estimates_are_as_rough_as_they_are_sure(seconds, words):
    assert in_words(seconds) == words
