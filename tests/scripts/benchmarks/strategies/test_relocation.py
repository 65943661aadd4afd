"""Relocation: the dead start again beside the living, and neither changes the picture."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.splats.strategy import Evidence
from cvdgs.scripts.benchmarks.strategies import Relocation

from ....core.splats.sets import gaussians, opinions

MOVES_ALONE = Relocation(growth=0.0, spread=0.0)


def refine(old, budget=0, strategy=MOVES_ALONE):
    return strategy.refine(old, Evidence(), budget, np.random.default_rng(0))


@pytest.mark.parametrize(("dead", "opacity_logit"), [(1, -2.0), (5, -2.0), (1, 0.0), (30, 0.0), (1, 3.0), (30, 3.0)])
def test_copies_at_one_place_look_together_as_the_one_did(dead, opacity_logit):
    old = gaussians(dead + 1, size=0.2, opacity_logit=opacity_logit)
    old.opacity_logits[1:] = -9.0
    new = refine(old).gaussians
    assert len(new) == dead + 1
    np.testing.assert_array_equal(new.means, np.repeat(old.means[:1], dead + 1, axis=0))
    # Blended along a line through the centre: the opacity there, and the integral of alpha.
    x = np.linspace(-40.0, 40.0, 200_001)
    alpha = new.opacities[0] * np.exp(-0.5 * (x / np.exp(new.log_scales[0, 0])) ** 2)
    together = 1.0 - (1.0 - alpha) ** (dead + 1)
    before = old.opacities[0] * np.exp(-0.5 * (x / 0.2) ** 2)
    assert together.max() == pytest.approx(before.max(), rel=1e-3)
    assert together.sum() == pytest.approx(before.sum(), rel=2e-3)


def test_the_dead_go_to_the_opaque_more_often_than_to_the_faint():
    old = gaussians(1002)
    old.opacity_logits[:] = -9.0
    old.opacity_logits[:2] = [3.0, -2.0]
    source = refine(old).source
    assert set(source) == {0, 1}
    assert 0.8 < (source == 0).mean() < 0.95


def test_the_set_grows_by_its_share_within_the_budget():
    old = gaussians(100)
    assert len(refine(old, 1000, Relocation(growth=0.1)).gaussians) == 110
    assert len(refine(old, 104, Relocation(growth=0.1)).gaussians) == 104
    assert len(refine(old, 50, Relocation(growth=0.1)).gaussians) == 100


def test_what_was_neither_dead_nor_copied_stays_as_it_was():
    old = gaussians(50)
    old.opacity_logits[7] = -9.0
    result = refine(old)
    untouched = ~result.fresh
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        np.testing.assert_array_equal(
            getattr(result.gaussians, name)[untouched], getattr(old, name)[result.source[untouched]]
        )
    assert untouched.sum() == 48


def test_a_scene_of_the_dead_is_left_alone():
    assert len(refine(gaussians(10, opacity_logit=-9.0)).gaussians) == 10


@given(st.integers(1, 60), st.integers(0, 80), st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_a_relocation_is_finite_and_never_loses_a_gaussian(count, budget, seed):
    rng = np.random.default_rng(seed)
    old = gaussians(count, seed=seed % 1000)
    old.opacity_logits[:] = rng.normal(0, 6, count)
    result = Relocation().refine(old, Evidence(), budget, rng)
    assert count <= len(result.gaussians) <= max(count, budget)
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        assert np.isfinite(getattr(result.gaussians, name)).all()


def test_what_is_broken_is_moved_like_the_dead():
    old = gaussians(3)
    old.means[1] = np.nan
    result = refine(old)
    assert len(result.gaussians) == 3
    assert 1 not in result.source


def test_noise_moves_the_faint_along_their_extent_and_leaves_the_opaque_in_place():
    old = gaussians(2000, size=0.01, opacity_logit=-6.0)
    old.log_scales[:, 0] = np.log(0.05)
    old.quaternions[:] = [1.0, 0.0, 0.0, 0.0]
    old.opacity_logits[1000:] = 3.0
    moved = Relocation().perturb(old, 1000, 6.4e-4, np.random.default_rng(0)).means - old.means
    assert np.abs(moved[1000:]).max() < 1e-6
    spread = moved[:1000].std(axis=0)
    assert spread[0] > 5 * spread[1] > 0
    assert np.linalg.norm(moved, axis=1).max() <= 0.0501


def test_over_a_run_decay_leaves_of_opacities_and_scales_what_it_says():
    strategy = Relocation(noise=0.0)
    now = old = gaussians(5)
    for _ in range(750 // strategy.perturb_every):
        now = strategy.perturb(now, 1000, 1e-4, np.random.default_rng(0))
    np.testing.assert_allclose(now.opacities, old.opacities * strategy.opacity_decay**0.75, rtol=1e-3)
    np.testing.assert_allclose(np.exp(now.log_scales - old.log_scales), strategy.scale_decay**0.75, rtol=1e-3)


def test_copies_part_from_their_original_but_stay_within_its_reach():
    old = gaussians(400, size=0.01)
    old.opacity_logits[1:] = -9.0
    away = np.linalg.norm(refine(old, strategy=Relocation(growth=0.0)).gaussians.means - old.means[0], axis=1)
    assert away[0] == 0.0
    assert 0.005 < np.median(away[1:]) < 0.02
    assert away.max() < 0.05


def test_copies_go_where_the_views_complain():
    old = gaussians(1000)
    old.opacity_logits[100:] = -9.0
    error = np.zeros((2, 1000))
    error[:, 40] = 0.5
    said = opinions(np.full((2, 1000), 20.0), error, complete=False)
    source = Relocation(growth=0.0).refine(old, Evidence(views=said), 0, np.random.default_rng(0)).source
    assert 0.7 < (source[100:] == 40).mean() < 0.9


def test_what_no_view_needs_is_moved_like_the_dead_when_all_views_were_asked():
    weight = np.full((2, 50), 20.0)
    weight[:, 10:] = 0.1
    for complete, unmoved in [(True, 10), (False, 50)]:
        said = opinions(weight, np.zeros((2, 50)), complete=complete)
        result = Relocation(growth=0.0).refine(gaussians(50), Evidence(views=said), 0, np.random.default_rng(0))
        assert len(result.gaussians) == 50
        assert len(set(result.source)) == unmoved
