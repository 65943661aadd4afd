"""Multi-view consistency: what several views complain about grows, what no view needs goes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.splats.strategy import Evidence, MultiViewConsistent

from ..sets import gaussians, opinions

ALWAYS = MultiViewConsistent(growth=1.0)


def refine(views, old=None, budget=10**6, strategy=ALWAYS):
    old = gaussians(len(views.seen)) if old is None else old
    return strategy.refine(old, Evidence(views=views), budget, np.random.default_rng(0))


def divided(result) -> set[int]:
    return set(result.source[result.fresh])


def test_only_what_two_views_complain_about_is_divided():
    weight = np.full((4, 3), 20.0)
    error = np.array([[0.3, 0.3, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert divided(refine(opinions(weight, error))) == {1}


def test_a_complaint_counts_only_from_a_view_that_shows_the_gaussian():
    weight = np.array([[20.0, 20.0], [0.01, 20.0]])
    assert divided(refine(opinions(weight, np.full((2, 2), 0.5)))) == {1}


def test_perfect_views_ask_for_nothing_and_keep_everything():
    result = refine(opinions(np.full((10, 50), 20.0), np.zeros((10, 50))))
    np.testing.assert_array_equal(result.source, np.arange(50))
    assert not result.fresh.any()


@pytest.mark.parametrize("views", [1, 2, 3])
def test_few_views_are_enough(views):
    result = refine(opinions(np.full((views, 5), 20.0), np.full((views, 5), 0.5)))
    assert divided(result) == set(range(5))


def test_the_largest_errors_of_complaining_views_come_first_when_there_is_little_room():
    weight = np.tile(np.linspace(10, 30, 20), (3, 1))
    result = refine(opinions(weight, np.full((3, 20), 0.5)), budget=25)
    assert len(result.gaussians) == 25
    assert divided(result) == set(range(15, 20))


def test_growth_in_a_round_is_limited():
    result = refine(opinions(np.full((3, 100), 20.0), np.full((3, 100), 0.5)), strategy=MultiViewConsistent(growth=0.3))
    assert len(result.gaussians) == 130


def test_in_small_photographs_a_gaussian_may_cover_less_than_two_pixels():
    """It has to cover a share of what the others do."""
    weight = np.array([[1.0, 1.2, 0.9, 1.1, 0.5, 0.1]] * 3)
    np.testing.assert_array_equal(refine(opinions(weight, np.zeros((3, 6)))).source, [0, 1, 2, 3, 4])
    np.testing.assert_array_equal(refine(opinions(20.0 * weight, np.zeros((3, 6)))).source, np.arange(6))


def test_what_no_view_needs_is_removed_when_all_views_were_asked():
    weight = np.array([[20.0, 0.5, 0.0], [0.0, 0.5, 0.0]])
    asked_all = opinions(weight, np.zeros((2, 3)))
    np.testing.assert_array_equal(refine(asked_all).source, [0])
    asked_some = opinions(weight, np.zeros((2, 3)), complete=False)
    np.testing.assert_array_equal(refine(asked_some).source, [0, 1, 2])


def test_without_pruning_nothing_is_removed_and_the_views_are_not_asked_for_it():
    strategy, steps = MultiViewConsistent(prune=False), 5000
    unneeded = opinions(np.array([[20.0, 0.5, 0.0], [0.0, 0.5, 0.0]]), np.zeros((2, 3)))
    np.testing.assert_array_equal(refine(unneeded, strategy=strategy).source, [0, 1, 2])
    rounds = [step for step in range(1, steps + 1) if strategy.schedule.due(step, steps)]
    assert {strategy.views_wanted(step, steps, 43) for step in rounds} == {10}


def test_a_blot_before_one_lens_is_removed_and_a_near_object_that_others_see_is_not():
    weight = np.full((4, 6), 20.0)
    weight[1:, 4] = 0.0
    distance = np.full((4, 6), 5.0)
    distance[:, 4:] = 0.5
    np.testing.assert_array_equal(refine(opinions(weight, np.zeros((4, 6)), distance=distance)).source, [0, 1, 2, 3, 5])


def test_what_is_transparent_or_broken_is_removed():
    old = gaussians(4)
    old.opacity_logits[1] = -9.0
    old.means[2, 0] = np.nan
    old.sh[3] = np.inf
    views = opinions(np.full((2, 4), 20.0), np.zeros((2, 4)), complete=False)
    np.testing.assert_array_equal(refine(views, old).source, [0])


def test_a_scene_in_which_nothing_is_needed_yet_is_not_emptied():
    assert len(refine(opinions(np.zeros((3, 5)), np.zeros((3, 5)))).gaussians) == 5


@given(st.integers(1, 12), st.integers(1, 40), st.integers(0, 60), st.booleans(), st.integers(0, 2**31))
@settings(max_examples=50, deadline=None)
def test_a_refinement_is_sound_whatever_the_views_say(views, count, budget, complete, seed):
    rng = np.random.default_rng(seed)
    weight = rng.exponential(3.0, (views, count)) * (rng.random((views, count)) < 0.7)
    said = opinions(weight, rng.random((views, count)), threshold=0.5, complete=complete)
    old = gaussians(count, seed=seed % 1000)
    result = refine(said, old, budget)
    assert len(result.gaussians) == len(result.source) == len(result.fresh)
    assert len(result.gaussians) <= max(budget, count)
    assert np.isfinite(result.gaussians.means).all()
    twice = np.bincount(result.source[result.fresh], minlength=count)
    assert set(twice) <= {0, 2}  # divided into two, and not kept beside
    assert not set(result.source[~result.fresh]) & divided(result)
    np.testing.assert_array_equal(result.gaussians.sh, old.sh[result.source])


def test_a_sample_of_the_views_is_asked_and_now_and_then_all_of_them():
    strategy, steps = MultiViewConsistent(), 5000
    rounds = [step for step in range(1, steps + 1) if strategy.schedule.due(step, steps)]
    wanted = [strategy.views_wanted(step, steps, 43) for step in rounds]
    assert set(wanted) == {10, 43}
    assert 2 <= wanted.count(43) <= len(rounds) // 3
    few = [strategy.views_wanted(step, steps, 4) for step in rounds]
    assert [count == 4 for count in few] == [count == 43 for count in wanted], "what is pruned does not depend on it"
    assert strategy.views_wanted(rounds[0], steps, 400) == 50
