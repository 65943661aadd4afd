"""Which runs leave Gaussians out of their steps, and what a step does to those that it leaves out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit

from cvdgs.core.splats.raster import ParameterSet, Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import prepare_targets
from cvdgs.core.splats.training.dropout import dropout_share, with_dropout
from cvdgs.core.splats.training.fitting import Fit
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.start import StartRule

from .test_trainer import BLACK, photographs, train, wall

INVISIBLE = 1.0 / 255.0  # alpha that the rasteriser does not draw


@pytest.fixture(scope="module")
def scene():
    return wall(400)


def opacities(parameters: ParameterSet) -> np.ndarray:
    return expit(parameters.opacity_logits.numpy().astype(np.float64))


@given(st.integers(1, 200), st.integers(1, 20_000))
def test_only_runs_that_fit_few_photographs_very_often_leave_gaussians_out(views, steps):
    assert dropout_share(steps, views) == (0.1 if views <= 10 and steps / views >= 200 else 0.0)


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_some_are_invisible_and_the_mean_opacity_stays(scene, share):
    parameters = ParameterSet.from_gaussians(replace(scene, opacity_logits=np.full(400, -1.0, np.float32)))
    drawn = np.stack([opacities(with_dropout(parameters, share, seed)) for seed in range(300)])
    assert drawn.mean() == pytest.approx(opacities(parameters).mean(), rel=0.01)
    assert (drawn < INVISIBLE).mean() == pytest.approx(share, rel=0.02)


def test_the_same_seed_leaves_the_same_ones_out_and_another_one_others(scene):
    parameters = ParameterSet.from_gaussians(scene)
    first, again, other = (with_dropout(parameters, 0.3, seed).opacity_logits.numpy() for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    np.testing.assert_array_equal(parameters.opacity_logits.numpy(), scene.opacity_logits)
    assert with_dropout(parameters, 0.0, 4) is parameters


@pytest.mark.filterwarnings("error")
def test_opacities_at_the_ends_of_their_range_stay_finite(scene):
    extreme = np.tile(np.array([-9e3, -100.0, 100.0, 9e3], np.float32), 100)
    logits = with_dropout(
        ParameterSet.from_gaussians(replace(scene, opacity_logits=extreme)), 0.1, 0
    ).opacity_logits.numpy()
    assert np.isfinite(logits).all()
    assert logits[extreme < 0.0].max() < -9.0
    assert logits.max() > 5.0


def test_a_step_moves_what_it_draws_and_nothing_else(scene):
    views, rasterizer = photographs(scene, count=2), Rasterizer("cpu")
    frame = SceneFrame.around(views, scene.means)
    target = prepare_targets(rasterizer, views, frame, BLACK)[0]
    fit = Fit(rasterizer, frame.from_world(replace(scene, sh=scene.sh * 0.5)), BLACK, 0.2, dropout=0.4)
    drawn = opacities(with_dropout(fit.parameters, 0.4, 1)) >= INVISIBLE
    before = fit.parameters.to_gaussians()
    fit.step(target, 1, TrainingPlan().learning_rates)
    after = fit.parameters.to_gaussians()
    for name in ("means", "opacity_logits", "sh"):
        moved = (getattr(before, name) != getattr(after, name)).reshape(len(scene), -1).any(axis=1)
        assert not moved[~drawn].any()
        assert moved[drawn].mean() > 0.5
    assert np.abs(after.opacity_logits - before.opacity_logits).max() < 0.5, "none keeps the opacity it was drawn with"


def test_a_run_says_so_and_is_the_same_again(scene):
    views = photographs(scene, count=3)
    plan = TrainingPlan(steps=600, sh_degree=0, start=StartRule(dense=None))
    first, again = (train(views, scene.means, plan) for _ in range(2))
    assert first.decision["dropout"] == "10% of the Gaussians left out of each step, since photographs are few"
    np.testing.assert_array_equal(first.gaussians.means, again.gaussians.means)
    assert "dropout" not in train(views, scene.means, replace(plan, steps=590)).decision
    told_all = replace(plan, limit=400, stopping=None)
    assert "dropout" not in train(views, scene.means, told_all).decision, "nothing was left to decide"
