"""A few of many: their order, their ends, their spacing."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.intake.sampling import evenly_spread


@given(st.integers(0, 300), st.integers(0, 40))
def test_no_more_are_chosen_than_wanted_and_none_twice(count, most):
    chosen = evenly_spread(range(count), most)
    assert len(chosen) == min(count, most)
    assert chosen == sorted(set(chosen))


@given(st.integers(2, 300), st.integers(2, 40))
def test_the_first_and_the_last_are_among_them_and_gaps_differ_by_one_at_most(count, most):
    chosen = evenly_spread(range(count), most)
    gaps = [later - earlier for earlier, later in itertools.pairwise(chosen)]
    assert (chosen[0], chosen[-1]) == (0, count - 1)
    assert max(gaps) - min(gaps) <= 1


def test_a_few_letters_keep_their_order():
    assert evenly_spread("abcdefg", 3) == ["a", "d", "g"]
    assert evenly_spread("abc", 1) == ["a"]
    assert evenly_spread("", 3) == []
