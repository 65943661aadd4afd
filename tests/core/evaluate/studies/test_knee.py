"""The knee: on curves whose plateau and knee are known."""

import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.evaluate.studies.knee import TOLERANCE, find_knee, quality_at


@dataclass(frozen=True)
class Run:
    gaussians: int
    psnr: float
    processor_seconds: float = 1.0


def runs_of(curve, sizes):
    return [Run(size, curve(size)) for size in sizes]


SIZES = [1000, 1414, 2000, 2828, 4000, 5657, 8000, 11314, 16000]


def test_a_curve_that_rises_to_a_corner_has_its_knee_just_before_it():
    def rising(size):  # 1 dB a doubling up to 4000, nothing beyond
        return 30.0 + min(math.log2(size / 4000.0), 0.0)

    knee = find_knee(runs_of(rising, SIZES))
    assert knee.plateau == pytest.approx(30.0)
    assert knee.gaussians == pytest.approx(4000 * 2.0**-TOLERANCE, rel=1e-3)


def test_the_knee_of_an_ever_rising_curve_is_near_the_end():
    knee = find_knee(runs_of(lambda size: math.log2(size), SIZES))
    assert knee.gaussians == pytest.approx(16000 * 2.0**-TOLERANCE, rel=1e-3)


def test_a_scene_that_needs_no_more_than_the_least_has_its_knee_there():
    assert find_knee(runs_of(lambda size: 30.0, SIZES)).gaussians == SIZES[0]


def test_quality_that_falls_again_does_not_move_the_knee():
    falling = runs_of(lambda size: 30.0 - abs(math.log2(size / 4000.0)), SIZES)
    knee = find_knee(falling)
    assert knee.plateau == pytest.approx(30.0)
    assert knee.gaussians == pytest.approx(4000 * 2.0**-TOLERANCE, rel=1e-3)


@given(st.permutations(SIZES))
def test_the_order_of_the_runs_is_of_no_matter(sizes):
    assert find_knee(runs_of(math.log2, sizes)) == find_knee(runs_of(math.log2, SIZES))


def test_quality_between_runs_is_read_off_the_logarithm():
    runs = [Run(1000, 28.0), Run(4000, 30.0)]
    assert quality_at(runs, 2000) == pytest.approx(29.0)
    assert quality_at(runs, 500) == 28.0
    assert quality_at(runs, 9000) == 30.0
