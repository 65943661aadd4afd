"""Clone, split and prune: what grows, what goes, and that the budget holds."""

import numpy as np
import pytest

from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.strategy import Evidence
from cvdgs.scripts.benchmarks.strategies import CloneSplitPrune

from ....core.splats.sets import gaussians


def refine(old: Gaussians, gradient, budget: int = 10**6):
    return CloneSplitPrune().refine(old, Evidence(np.asarray(gradient, np.float32)), budget, np.random.default_rng(0))


def test_a_small_gaussian_with_a_large_gradient_is_cloned_in_place():
    result = refine(gaussians(3), [0.0, 1.0, 0.0])
    assert len(result.gaussians) == 4
    np.testing.assert_array_equal(result.source, [0, 1, 2, 1])
    np.testing.assert_array_equal(result.fresh, [False, False, False, True])
    np.testing.assert_array_equal(result.gaussians.means[3], result.gaussians.means[1])


def test_a_large_gaussian_with_a_large_gradient_becomes_two_smaller_ones_inside_it():
    old = gaussians(3, size=0.05)
    result = refine(old, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(result.source, [0, 2, 1, 1])
    np.testing.assert_allclose(np.exp(result.gaussians.log_scales[2:]), 0.05 / 1.6, rtol=1e-5)
    assert (np.linalg.norm(result.gaussians.means[2:] - old.means[1], axis=1) < 0.05 * 5).all()
    assert (result.gaussians.means[2] != result.gaussians.means[3]).any()


def test_without_gradient_nothing_is_added():
    result = refine(gaussians(50), np.zeros(50))
    np.testing.assert_array_equal(result.source, np.arange(50))
    assert not result.fresh.any()


def test_transparent_and_broken_gaussians_are_removed():
    old = gaussians(5)
    old.opacity_logits[1] = -9.0
    old.means[2, 0] = np.nan
    old.log_scales[3, 1] = np.inf
    np.testing.assert_array_equal(refine(old, np.zeros(5)).source, [0, 4])


@pytest.mark.parametrize("size", [0.001, 0.05])
def test_growth_stays_within_the_budget_and_prefers_the_largest_gradients(size):
    result = refine(gaussians(100, size), np.arange(100) + 1.0, budget=110)
    assert len(result.gaussians) == 110
    assert set(result.source[result.fresh]) == set(range(90, 100))


def test_a_budget_below_the_present_number_adds_nothing_and_removes_nothing():
    assert len(refine(gaussians(100), np.ones(100), budget=10).gaussians) == 100


@pytest.mark.parametrize("steps", [1, 50, 500, 5000, 30_000])
def test_the_schedule_suits_a_run_of_any_length(steps):
    strategy = CloneSplitPrune()
    due = [step for step in range(1, steps + 1) if strategy.schedule.due(step, steps)]
    assert len(due) <= strategy.schedule.rounds + 2
    if steps >= 50:
        assert len(due) >= min(strategy.schedule.rounds, steps // 4)
    assert all(strategy.schedule.start * steps - 1 <= step <= strategy.schedule.stop * steps + 1 for step in due)


def test_the_budget_rises_from_the_initial_number_to_the_limit():
    strategy = CloneSplitPrune()
    budgets = [strategy.schedule.budget(step, 1000, 100, 900) for step in range(0, 1001, 10)]
    assert budgets[0] == 100
    assert budgets[-1] == 900
    assert budgets == sorted(budgets)
