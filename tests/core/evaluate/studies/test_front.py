"""The Pareto front: nothing on it is dominated, and everything else is."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.evaluate.studies.front import pareto_front

# Few different values, so that equal costs and values come up often.
figures = st.lists(st.tuples(st.integers(0, 6).map(float), st.integers(0, 6).map(float)), max_size=30)


def dominates(first: tuple[float, float], second: tuple[float, float]) -> bool:
    return first[0] <= second[0] and first[1] >= second[1] and first != second


@given(figures)
def test_the_front_is_what_nothing_dominates(points: list[tuple[float, float]]):
    front = pareto_front([cost for cost, _ in points], [value for _, value in points])
    undominated = {i for i, p in enumerate(points) if not any(dominates(other, p) for other in points)}
    assert set(front) == undominated
    assert len(front) == len(undominated)


@given(figures)
def test_the_front_goes_from_cheap_to_dear(points: list[tuple[float, float]]):
    front = pareto_front([cost for cost, _ in points], [value for _, value in points])
    assert [points[i] for i in front] == sorted(points[i] for i in front)


def test_what_was_not_measured_takes_no_part():
    assert pareto_front([1.0, 2.0, math.nan, 0.5], [5.0, math.nan, 9.0, 3.0]) == [3, 0]


@pytest.mark.parametrize("points", [[], [(1.0, 2.0)]], ids=["none", "one"])
def test_few_points_are_their_own_front(points):
    assert pareto_front([p[0] for p in points], [p[1] for p in points]) == list(range(len(points)))
