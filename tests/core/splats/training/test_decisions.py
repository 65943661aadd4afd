"""Automatic decisions on known curves: how many Gaussians, steps and SH degrees, and which views validate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.splats.strategy import Schedule
from cvdgs.core.splats.training.decisions import (
    GrowthRule,
    GrowthTrial,
    Measurement,
    ShDegreeRule,
    StopRule,
    split_views,
)
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.schedule import TrainingSchedule


def rounds(counts, psnr):
    """Measurements whose work is the sum of the counts so far."""
    work = np.cumsum(counts)
    return [Measurement(i, n, p, int(w)) for i, (n, p, w) in enumerate(zip(counts, psnr, work, strict=True))]


def test_growth_continues_while_a_doubling_gains_enough():
    counts = [1000 * 2**i for i in range(6)]
    assert GrowthRule().verdict(rounds(counts, [20.0, 22.0, 24.0, 25.5, 26.5, 27.5])) is None


def test_growth_ends_when_a_doubling_gains_too_little_and_says_so():
    counts = [1000 * 2**i for i in range(6)]
    verdict = GrowthRule(doubling_gain=0.4).verdict(rounds(counts, [20.0, 22.0, 24.0, 24.2, 24.4, 24.6]))
    assert verdict == "doubling them gained 0.20 dB, less than 0.4"


def test_growth_ends_when_time_gains_too_little_though_the_number_hardly_changes():
    verdict = GrowthRule().verdict(rounds([1000, 1010, 1020, 1030, 1040, 1050], [24.0] * 6))
    assert "time" in verdict


def test_growth_is_not_judged_by_its_first_rounds():
    assert GrowthRule(window=3).verdict(rounds([1000, 2000, 4000], [24.0, 24.0, 24.0])) is None


def test_gaussians_are_worth_it_for_psnr_or_for_contrast():
    rule = GrowthRule(doubling_gain=0.4, contrast_gain=0.01)
    assert rule.pays(GrowthTrial(psnr=0.5, contrast=0.0))
    assert rule.pays(GrowthTrial(psnr=-0.1, contrast=0.02))
    assert not rule.pays(GrowthTrial(psnr=0.3, contrast=0.005))


def test_contrast_that_comes_with_a_loss_of_psnr_is_not_worth_more_gaussians():
    rule = GrowthRule(contrast_gain=0.01, bearable_loss=0.2)
    assert rule.pays(GrowthTrial(psnr=-0.2, contrast=0.02))
    assert not rule.pays(GrowthTrial(psnr=-0.3, contrast=0.02))


def test_few_photographs_may_have_twice_as_many_gaussians_for_their_pixels_as_many_photographs():
    photograph = 240 * 180
    assert GrowthRule().ceiling(10 * photograph) == 10 * photograph // 50
    assert GrowthRule().ceiling(40 * photograph) == 40 * photograph // 100
    assert GrowthRule(fewest=500).ceiling(1) == 500


@given(st.integers(0, 10**9), st.integers(0, 10**9))
def test_more_pixels_never_mean_fewer_gaussians(first, second):
    fewer, more = sorted((first, second))
    assert GrowthRule().ceiling(fewer) <= GrowthRule().ceiling(more)


def test_a_trial_of_growth_is_made_where_it_can_tell_and_takes_a_small_share_of_the_run():
    rule = GrowthRule()
    assert rule.trial_steps(100) == 0
    assert 0 < rule.trial_steps(1000) <= 100
    assert rule.trial_steps(20_000) == 2 * rule.trial_steps(10_000)
    assert rule.tells(1000, 1300)
    assert not rule.tells(1000, 1010)
    assert not rule.tells(1000, 900)


@given(st.lists(st.floats(5, 40), min_size=5, max_size=12))
def test_views_that_get_worse_always_end_growth(psnr):
    falling = sorted(psnr, reverse=True)
    assert GrowthRule().verdict(rounds([1000 * 2**i for i in range(len(psnr))], falling)) is not None


def test_a_run_continues_while_it_gains_and_ends_after_its_patience():
    rule = StopRule(patience=0.15, min_gain=0.02)
    rising = [Measurement(step, 1, 20.0 + step / 1000, 1) for step in range(25, 1001, 25)]
    assert not rule.should_stop(rising, 1000)
    flat = [*rising, *(Measurement(1000 + step, 1, 21.0, 1) for step in range(25, 126, 25))]
    assert not rule.should_stop(flat, 1000)
    assert rule.should_stop([*flat, Measurement(1150, 1, 21.0, 1)], 1000)
    assert not rule.should_stop([], 1000)


@given(st.integers(1, 500), st.integers(0, 100))
def test_every_view_is_fitted_or_validates_and_enough_are_fitted(training, held_out):
    split = split_views(training, held_out)
    assert sorted(split.fitted + split.validation) == list(range(training))
    assert len(split.fitted) >= max(1, 0.85 * training)
    assert not (split.validation and split.validate_on_held_out)


@pytest.mark.parametrize(
    ("training", "held_out", "validation", "on_held_out"),
    [(43, 7, 2, False), (200, 20, 6, False), (9, 2, 0, True), (9, 0, 1, False), (3, 0, 0, False), (24, 0, 1, False)],
)
def test_held_out_views_validate_only_if_there_are_too_few_others(training, held_out, validation, on_held_out):
    split = split_views(training, held_out)
    assert (len(split.validation), split.validate_on_held_out) == (validation, on_held_out)
    assert ("optimistic" in split.reason) == on_held_out


def test_when_growth_ends_early_the_rest_settles_as_long_as_planned():
    """A plateau at high learning rates says nothing about the gain at falling ones."""
    schedule, whole = (TrainingSchedule(TrainingPlan(steps=1000), Schedule(0.1, 0.5, 10)) for _ in range(2))
    schedule.end_growth()
    assert schedule.steps == 1000
    assert not schedule.growing(301)
    assert not any(schedule.refines(step) for step in range(301, 1001))
    assert all(schedule.learning_rates(step) == whole.learning_rates(step) for step in range(1001))


def test_a_run_that_ends_early_goes_on_with_the_part_of_the_contrast_hinge():
    plan = TrainingPlan(steps=1000)
    schedule, whole = (TrainingSchedule(plan, Schedule(0.1, 0.5, 10)) for _ in range(2))
    schedule.skip_to_contrast(600)
    assert schedule.steps == 800
    assert [schedule.learning_rates(600 + i) for i in range(201)] == [whole.learning_rates(800 + i) for i in range(201)]
    assert all(schedule.contrast(step) for step in range(601, 801))
    schedule.skip_to_contrast(700)  # where it counts already
    assert schedule.steps == 800


@given(st.integers(1, 5000))
def test_learning_rates_never_rise(steps):
    schedule = TrainingSchedule(TrainingPlan(steps=steps), Schedule(0.1, 0.6, 10))
    rates = [schedule.learning_rates(step).means for step in range(steps + 1)]
    assert rates == sorted(rates, reverse=True)


@given(st.integers(1, 50_000))
def test_a_trial_of_a_degree_is_never_long_beside_its_run(steps):
    trial = ShDegreeRule().trial_steps(steps)
    assert 0 <= trial <= 0.1 * steps
    assert trial == 0 or trial >= ShDegreeRule().fewest_steps
    assert (trial > 0) == (steps >= 1200)


@pytest.mark.parametrize(("steps", "ends"), [(150, 0.25), (399, 0.25), (400, 0.9), (5000, 0.9)])
def test_short_runs_fit_all_photographs_as_soon_as_corrections_were_tried(steps, ends):
    plan = TrainingPlan(steps=steps)
    assert plan.validation_ends == ends
    assert all(check < ends for check, _ in plan.poses.checks)
    assert max(plan.exposure.decided_at, plan.blur.decided_at) < ends
