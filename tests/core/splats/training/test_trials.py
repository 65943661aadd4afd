"""A trial decides between two ways to go on, and the run goes on from the end of the one that is chosen."""

import numpy as np
import pytest

from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import Background, prepare_targets
from cvdgs.core.splats.training.decisions import GrowthRule
from cvdgs.core.splats.training.fitting import Fit
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.trials import more_pay, try_correction

from .test_trainer import photographs, wall

BLACK = Background((0.0, 0.0, 0.0))
RATES = TrainingPlan().learning_rates


@pytest.fixture
def scene():
    return wall(100)


@pytest.fixture
def fit_and_step(scene):
    """The scene being fitted to its own photographs in other colours, and a function that does some steps of that."""
    rasterizer, views = Rasterizer("cpu"), photographs(scene, 3)
    frame = SceneFrame.around(views, scene.means)
    targets = prepare_targets(rasterizer, views, frame, BLACK)
    start = frame.from_world(scene)
    start.sh[:] *= 0.5
    fit = Fit(rasterizer, start, BLACK, 0.2)

    def steps(count: int) -> None:
        for number in range(count):
            fit.step(targets[number % len(targets)], 1, RATES)

    return fit, steps


@pytest.mark.parametrize("is_kept", [True, False])
def test_a_run_goes_on_from_the_end_of_the_branch_that_a_correction_chose(fit_and_step, is_kept):
    fit, steps = fit_and_step
    ends, told = {}, []

    def branch(corrected: bool) -> float:
        steps(5 if corrected else 3)
        ends[corrected] = fit.parameters.to_gaussians()
        return 31.5 if corrected else 30.0

    def settle(gain: float) -> bool:
        told.append(gain)
        return is_kept

    assert try_correction(fit, branch, settle) is is_kept
    assert told == [1.5]
    np.testing.assert_array_equal(fit.parameters.to_gaussians().sh, ends[is_kept].sh)
    assert not np.array_equal(ends[True].sh, ends[False].sh)


@pytest.mark.parametrize("gain", [2.0, 0.0])
def test_a_run_goes_on_from_the_end_of_the_branch_that_growth_chose(fit_and_step, scene, gain):
    fit, steps = fit_and_step
    grown = fit.parameters.to_gaussians().take(np.arange(100).repeat(2))
    ends = {}

    def branch(count: int) -> tuple[float, float]:
        steps(count)
        ends[len(fit)] = fit.parameters.to_gaussians()
        return 30.0 + gain * (len(fit) > 100), 0.5

    pays, words = more_pay(fit, GrowthRule(), 1000, grown, branch)
    assert pays is (gain > 0.0)
    assert "in a trial" in words
    chosen = ends[200 if pays else 100]
    np.testing.assert_array_equal(fit.parameters.to_gaussians().sh, chosen.sh)
