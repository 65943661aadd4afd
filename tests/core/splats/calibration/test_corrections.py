"""Corrections in a training run: decided by measuring, reported in words, and worthwhile where they are on."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.calibration.corrections import Proposal, ViewCorrections
from cvdgs.core.splats.calibration.exposure import ExposurePlan
from cvdgs.core.splats.calibration.poses import PosePlan
from cvdgs.core.splats.raster import ParameterSet, Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import Background, prepare_targets
from cvdgs.core.splats.training.decisions import StopRule
from cvdgs.core.splats.training.plan import TrainingPlan, TrainingResult
from cvdgs.core.splats.training.trainer import Trainer

from .test_exposure import lit
from .test_poses import BLACK, ball, errors, photographs, turned

EVERY = 6  # view is held out


@pytest.fixture(scope="module")
def scene():
    return ball()


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene, size=96)


def train(scene, training, held_out, **settings) -> TrainingResult:
    plan = TrainingPlan(**{"steps": 400, "limit": 800, "stopping": None, "poses": None, "curve_points": 1, **settings})
    grey = np.full((len(scene), 3), 128, np.uint8)
    return Trainer(Rasterizer("cpu", 1), training, held_out, scene.means, grey, plan, BLACK, 0).train(Reporter())


def parts(views):
    return [view for i, view in enumerate(views) if i % EVERY], views[::EVERY]


def test_a_run_on_photographs_of_different_exposure_keeps_the_scene_clear_of_it(scene, views):
    log_gains = np.random.default_rng(1).normal(0.0, 0.2, (len(views), 3))
    training, held_out = parts(lit(views, log_gains))[0], parts(lit(views, 0.0 * log_gains))[1]
    corrected, plain = (train(scene, training, held_out, stopping=StopRule(), **s) for s in ({}, {"exposure": None}))
    assert corrected.decision["exposure"].startswith("corrected")
    assert "trial" in corrected.decision["exposure"]
    assert "exposure" not in plain.decision
    assert corrected.curve[-1]["psnr"] > plain.curve[-1]["psnr"] + 0.4
    assert corrected.curve[-1]["psnr_any_exposure"] > plain.curve[-1]["psnr"] + 0.6


def assert_nothing_is_lost(tried: TrainingResult, plain: TrainingResult) -> None:
    """The steps of the branch that is kept are steps of the run."""
    assert tried.curve[-1]["psnr"] > plain.curve[-1]["psnr"] - 0.05


@pytest.mark.parametrize("size", [48, 96, 160])
def test_photographs_of_one_exposure_stay_as_they_are_however_rough_the_scene(scene, size):
    training, held_out = parts(photographs(scene, count=30, size=size))
    suspicious = ExposurePlan(threshold=0.0)  # any rough scene seems to be lit differently
    tried, plain = (
        train(scene, training, held_out, steps=150, stopping=StopRule(), exposure=plan) for plan in (suspicious, None)
    )
    assert tried.decision["exposure"].startswith("as photographed")
    assert "trial" in tried.decision["exposure"]
    assert_nothing_is_lost(tried, plain)


def test_a_run_with_poses_half_a_degree_off_hands_back_better_ones(scene, views):
    truth, held_out = parts(views)
    given = turned(truth, 0.5)
    result = train(scene, given, held_out, exposure=None, poses=PosePlan())
    assert result.decision["poses"].startswith("corrected")
    refined = [replace(view, world_to_camera=result.moved_poses[view.key]) for view in given]
    assert errors(refined, truth, scene.means)[1] < 0.6 * errors(given, truth, scene.means)[1]


def test_validation_views_are_aligned_with_the_scene_before_they_are_measured(scene):
    views = turned(photographs(scene, count=30, size=96), 1.0)
    training, held_out = views[:-2], views[-2:]
    result = train(scene, training, held_out, exposure=None, poses=PosePlan(), stopping=StopRule(), curve_points=5)
    assert "held back" in result.decision["views"]
    decided = {entry["step"]: entry for entry in result.curve if "deciding_psnr" in entry}
    late = decided[320]
    assert late["deciding_psnr"] > late["psnr"] + 1.0  # held-out views are not aligned before the end
    assert result.curve[-1]["psnr"] > late["psnr"] + 1.0


def test_held_out_views_are_as_far_off_as_the_others_and_are_aligned_with_the_scene(scene, views):
    truth, held_out = parts(views)
    given, judging = turned(truth, 0.5), turned(held_out, 0.5)
    aligned, plain = (train(scene, given, judging, exposure=None, poses=poses) for poses in (PosePlan(), None))
    assert set(aligned.moved_poses) == {view.key for view in views}
    assert aligned.curve[-1]["psnr"] > plain.curve[-1]["psnr"] + 1.0


def test_a_run_with_good_poses_hands_none_back(scene, views):
    training, held_out = parts(views)
    result = train(scene, training, held_out, exposure=None, poses=PosePlan())
    assert result.decision["poses"].startswith("as given")
    assert result.moved_poses == {}


@pytest.mark.parametrize("size", [48, 96])
def test_good_poses_stay_as_they_are_however_far_off_a_rough_scene_makes_them_look(scene, size):
    training, held_out = parts(photographs(scene, count=30, size=size))
    suspicious = PosePlan(checks=((0.1, 0.0), (0.2, 0.0)), least_steps=1)
    tried, plain = (
        train(scene, training, held_out, steps=150, stopping=StopRule(), exposure=None, poses=poses)
        for poses in (suspicious, None)
    )
    assert tried.decision["poses"].startswith("as given")
    assert "trial" in tried.decision["poses"]
    assert tried.moved_poses == {}
    assert_nothing_is_lost(tried, plain)


def test_poses_that_are_off_are_corrected_because_validation_views_gain_by_it(scene):
    views = turned(photographs(scene, count=30, size=96), 0.5)
    result = train(scene, *parts(views), exposure=None, poses=PosePlan(), stopping=StopRule())
    assert result.decision["poses"].startswith("corrected")
    assert "trial" in result.decision["poses"]


@pytest.mark.parametrize(("degrees", "far_off"), [(1.0, True), (0.25, False)])
def test_views_that_are_far_off_are_moved_to_where_they_match_a_scene(scene, degrees, far_off):
    truth = photographs(scene, count=12)
    given, rasterizer = turned(truth, degrees), Rasterizer("cpu", 1)
    frame = SceneFrame.around(given, scene.means)
    settled = ParameterSet.from_gaussians(frame.from_world(scene))
    targets = prepare_targets(rasterizer, given, frame, BLACK)
    corrections = ViewCorrections(rasterizer, targets, BLACK, None, PosePlan(), None, steps=1000)
    assert corrections.decide(0.2, settled) == [Proposal.POSES]
    corrections.switch(Proposal.POSES, True)
    assert corrections.match_poses(settled) == far_off
    assert corrections.moved_poses is not None
    moved = [view.at(frame.pose_to_world(pose)) for view, pose in zip(given, corrections.moved_poses, strict=True)]
    before, after = (errors(views, truth, scene.means)[1] for views in (given, moved))
    assert after < 0.8 * before if far_off else after == pytest.approx(before)


def test_a_run_that_is_too_short_to_tell_leaves_poses_alone(scene, views):
    training, held_out = parts(views)
    result = train(scene, turned(training, 0.5), held_out, steps=120, exposure=None, poses=PosePlan())
    assert "poses" not in result.decision
    assert result.moved_poses == {}


def test_exposures_of_cut_outs_are_left_alone(scene, views):
    white = Background((1.0, 1.0, 1.0))
    rasterizer, frame = Rasterizer("cpu", 1), SceneFrame.around(views, scene.means)
    targets = prepare_targets(rasterizer, lit(views, np.linspace(-0.3, 0.3, len(views))), frame, white)
    for background, active in ((white, False), (BLACK, True)):
        corrections = ViewCorrections(rasterizer, targets, background, ExposurePlan(), None, None, steps=100)
        corrections.decide(0.5, ParameterSet.from_gaussians(frame.from_world(scene)))
        assert corrections.exposure.active == active
