"""Training and colour layers on a scene that the test makes: known Gaussians, photographed from known cameras."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import PinholeCamera, View
from cvdgs.core.color.noise import neighbour_difference
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.raster import ContrastPlan, Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.strategy import MultiViewConsistent
from cvdgs.core.splats.targets import Background, prepare_targets
from cvdgs.core.splats.training.decisions import GrowthRule, ShDegreeRule, StopRule
from cvdgs.core.splats.training.fitting import Fit
from cvdgs.core.splats.training.layers import LayerPlan, fit_layer
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.start import StartRule
from cvdgs.core.splats.training.trainer import Trainer
from cvdgs.scripts.benchmarks.strategies import CloneSplitPrune, Relocation

BLACK = Background((0.0, 0.0, 0.0))


def look_at(position, target) -> np.ndarray:
    """World-to-camera of a camera at `position`, OpenCV axes, z up in the world."""
    forward = np.asarray(target, float) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ position
    return pose


def wall(count: int, seed: int = 0) -> Gaussians:
    """A wall of overlapping, almost opaque coloured Gaussians, 20 units wide, far from the origin."""
    rng = np.random.default_rng(seed)
    means = np.column_stack([rng.uniform(-10, 10, count), 100 + rng.normal(0, 0.2, count), rng.uniform(-10, 10, count)])
    quaternions = rng.standard_normal((count, 4))
    return Gaussians(
        means=means.astype(np.float32),
        log_scales=np.log(rng.uniform(0.5, 1.2, (count, 3))).astype(np.float32),
        quaternions=quaternions.astype(np.float32),
        opacity_logits=np.full(count, 3.0, np.float32),
        sh=((rng.uniform(0, 1, (count, 1, 3)) - 0.5) / SH_C0).astype(np.float32),
    )


def photographs(scene: Gaussians, count: int = 9, size: tuple[int, int] = (96, 72)) -> list[View]:
    """Views of `scene` from an arc in front of it."""
    width, height = size
    camera = PinholeCamera(width, height, 1.1 * width, 1.2 * width, width / 2 + 1, height / 2 - 2)
    views = []
    for i, x in enumerate(np.linspace(-8, 8, count)):
        pose = look_at(np.array([x, 78.0, 2.0 * np.sin(i)]), [0, 100, 0])
        views.append(View(f"{i:02d}", Path(f"{i}.png"), camera, pose, np.zeros((height, width, 3), np.uint8)))
    renderer = SceneRenderer(Rasterizer("cpu"), views, BLACK)
    return [replace(view, image=renderer.color(scene, i)) for i, view in enumerate(views)]


def train(views, points, plan: TrainingPlan, held_out=(), seed=0):
    colors = np.full((len(points), 3), 128, np.uint8)
    trainer = Trainer(Rasterizer("cpu"), views, held_out, points, colors, plan, BLACK, seed)
    return trainer.train(Reporter())


@pytest.fixture(scope="module")
def scene():
    return wall(400)


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene)


def test_training_recovers_a_known_scene_on_views_that_it_has_not_seen(scene, views):
    plan = TrainingPlan(steps=300, limit=1500, stopping=None)
    result = train(views[:4] + views[5:], scene.means, plan, held_out=[views[4]])
    assert result.curve[0]["psnr"] < 17
    assert result.curve[-1]["psnr"] > 24
    assert result.curve[-1]["step"] == 300


def test_a_scene_without_points_is_nearly_as_good_as_with_them(scene, views):
    plan, training, held_out = TrainingPlan(steps=200, limit=1500), views[:4] + views[5:], [views[4]]
    with_points, without = (train(training, points, plan, held_out) for points in (scene.means, scene.means[:0]))
    assert without.curve[-1]["psnr"] > with_points.curve[-1]["psnr"] - 2.0


def test_the_same_seed_gives_the_same_bits(scene, views):
    plan = TrainingPlan(steps=60, limit=500)
    first, second = (train(views, scene.means, plan) for _ in range(2))
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(first.gaussians, name), getattr(second.gaussians, name))


def test_another_seed_gives_other_bits(scene, views):
    plan = TrainingPlan(steps=60, limit=500)
    first, second = (train(views, scene.means, plan, seed=seed) for seed in (0, 1))
    assert len(first.gaussians) != len(second.gaussians) or (first.gaussians.means != second.gaussians.means).any()


def test_there_are_never_more_gaussians_than_allowed(scene, views):
    result = train(views, scene.means, TrainingPlan(steps=200, limit=450))
    assert len(result.gaussians) <= 450
    assert all(item["gaussians"] <= 450 for item in result.curve)


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_the_result_has_the_degree_that_was_asked_for(scene, views, degree):
    result = train(views, scene.means, TrainingPlan(steps=20, limit=450, sh_degree=degree))
    assert result.gaussians.sh_degree == degree
    assert np.isfinite(result.gaussians.sh).all()


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_a_run_may_be_of_any_length(scene, views, steps):
    assert len(train(views, scene.means, TrainingPlan(steps=steps, limit=450)).gaussians) > 0


def test_without_held_out_views_the_curve_has_no_psnr(scene, views):
    assert all(item["psnr"] is None for item in train(views, scene.means, TrainingPlan(steps=20, limit=450)).curve)


def test_a_layer_reproduces_the_enhanced_views_and_leaves_the_geometry_alone(scene, views):
    swapped = [replace(view, image=np.ascontiguousarray(view.image[..., ::-1])) for view in views]
    layer = fit_layer(Rasterizer("cpu"), scene, swapped, LayerPlan(), BLACK, seed=0)
    for name in ("means", "log_scales", "quaternions", "opacity_logits"):
        np.testing.assert_array_equal(getattr(layer, name), getattr(scene, name))
    renderer = SceneRenderer(Rasterizer("cpu"), swapped, BLACK)
    assert min(renderer.fidelity(i, renderer.color(layer, i))["psnr"] for i in range(len(views))) > 35


def test_one_view_that_disagrees_does_not_pull_the_colours_of_a_layer(scene, views):
    drifted = [replace(view, image=np.minimum(view.image, 40)) if i == 4 else view for i, view in enumerate(views)]
    layer = fit_layer(Rasterizer("cpu"), scene, drifted, LayerPlan(), BLACK, seed=0)
    renderer = SceneRenderer(Rasterizer("cpu"), views, BLACK)
    assert renderer.fidelity(4, renderer.color(layer, 4))["psnr"] > 30


def test_a_layer_of_a_scene_with_view_dependent_colours_has_degree_0(views):
    scene = replace(wall(50), sh=np.zeros((50, 4, 3), np.float32))
    assert fit_layer(Rasterizer("cpu"), scene, views, LayerPlan(minimum_steps=5, epochs=1), BLACK, 0).sh_degree == 0


def test_a_cut_out_is_trained_over_white(views):
    alpha = np.zeros(views[0].image.shape[:2], np.uint8)
    alpha[20:40] = 255
    cut_out = replace(views[0], alpha=alpha)
    assert Background.of([cut_out]).color == (1.0, 1.0, 1.0)
    behind = Background.of([cut_out]).behind(cut_out)
    assert (behind[:20] == 255).all()
    np.testing.assert_array_equal(behind[20:40], views[0].image[20:40])


def test_a_reduced_target_is_the_mean_of_its_pixels_with_the_camera_to_match(views):
    frame = SceneFrame.around(views, np.zeros((0, 3), np.float32))
    image = views[0].image
    large = replace(
        views[0], image=np.kron(image, np.ones((4, 4, 1), np.uint8)), camera=views[0].camera.scaled(384, 288)
    )
    (target,) = prepare_targets(Rasterizer("cpu"), [large], frame, BLACK, {2, 4})
    reduced, camera = target.at(2)
    np.testing.assert_array_equal(reduced.numpy(), np.kron(image, np.ones((2, 2, 1), np.uint8)))
    given = views[0].camera
    assert (camera.width, camera.height, camera.fx, camera.cy) == (192, 144, 2.0 * given.fx, 2.0 * given.cy)
    assert target.at(4) is target.at(1)  # a quarter would be too small


def test_without_a_limit_a_run_decides_by_validation_views_and_reports_its_decisions(scene, views):
    plan = TrainingPlan(steps=400, sh_degree=None, sh_degree_rule=ShDegreeRule(fewest_steps=30))
    result = train(views[:4] + views[5:], scene.means, plan, held_out=[views[4]])
    assert set(result.decision) >= {"strategy", "views", "gaussians", "steps", "sh_degree"}
    assert "validated on the held-out views" in result.decision["views"]
    assert "in a trial" in result.decision["sh_degree"]
    assert result.gaussians.sh_degree == 0
    assert result.curve[-1]["psnr"] > 24
    assert result.curve[-1]["gaussians"] == len(result.gaussians)


def test_when_psnr_says_enough_a_trial_of_contrast_may_say_more(scene, views):
    def result(contrast_gain: float):
        asked = {"doubling_gain": 1e9, "work_gain": 1e9, "bearable_loss": 1e9, "fewest_trial_steps": 20, "window": 1}
        rule = GrowthRule(contrast_gain=contrast_gain, pixels_per_gaussian=20, **asked)
        run = TrainingPlan(steps=480, growth=rule, stopping=None, sh_degree=0, start=StartRule(dense=None))
        return train(views, scene.means, run)

    enough, more = result(1e9), result(-1e9)
    assert "of the contrast in a trial" in enough.decision["gaussians"]
    assert "growth paid" in more.decision["gaussians"]
    assert len(more.gaussians) > len(enough.gaussians)


def test_a_run_says_whether_it_allowed_for_noise(scene):
    smooth = photographs(wall(60), size=(192, 144))
    random = np.random.default_rng(0)
    noisy = [
        replace(view, image=np.clip(view.image + random.normal(0, 12, view.image.shape), 0, 255).astype(np.uint8))
        for view in smooth
    ]
    plan = TrainingPlan(steps=20, limit=200)
    told = [train(views, scene.means, plan).decision.get("noise", "") for views in (smooth, noisy)]
    assert told[0] == ""
    _, least = told[1].removesuffix(" ΔE on").split("allowed for: neighbouring pixels count as distinct from ")
    assert float(least) == pytest.approx(2.0 * neighbour_difference(12.0 / 255.0), rel=0.3)  # some is clipped by black


def test_view_dependent_colours_are_detected(views):
    rng = np.random.default_rng(3)
    matte = wall(150)
    sh = np.concatenate([matte.sh, rng.normal(0, 1.2, (150, 3, 3)).astype(np.float32)], axis=1)
    shiny = photographs(replace(matte, sh=sh), count=10)
    rule = ShDegreeRule(highest=1, largest_share=0.5)
    plan = TrainingPlan(steps=250, limit=300, sh_degree=None, coarse=(), sh_degree_rule=rule)
    result = train(shiny[:4] + shiny[5:], matte.means, plan, held_out=[shiny[4]])
    assert result.gaussians.sh_degree == 1
    assert "gained" in result.decision["sh_degree"]


def test_a_capture_of_many_views_holds_some_back_for_validation_besides_the_held_out_ones(scene):
    many = photographs(scene, count=26, size=(64, 48))
    result = train(many[:24] + many[25:], scene.means, TrainingPlan(steps=40, short_run=0), held_out=[many[24]])
    held_back = "1 of 25 training views held back for validation"
    assert result.decision["views"] == f"{held_back}, then fitted like the others from step 36"
    assert all(("deciding_psnr" in entry) == (entry["step"] < 36) for entry in result.curve)


def test_a_run_that_gains_nothing_more_ends_early_and_returns_its_best(scene, views):
    noise = np.random.default_rng(0)
    blind = [replace(view, image=noise.integers(0, 256, view.image.shape, np.uint8)) for view in views]
    result = train(blind[:4] + blind[5:], scene.means, TrainingPlan(steps=400, limit=600), held_out=[blind[4]])
    assert result.curve[-1]["step"] < 400
    assert result.curve[-1]["psnr"] >= max(entry["psnr"] for entry in result.curve[1:]) - 0.2


def test_the_contrast_hinge_has_its_part_in_a_run_that_ends_early(scene, views):
    stopping = StopRule(patience=0.1, min_gain=9.0)
    plan = TrainingPlan(steps=100, limit=500, stopping=stopping, exposure=None, contrast=ContrastPlan(weight=1.0))
    plans = (plan, replace(plan, contrast=ContrastPlan(weight=0.0)), replace(plan, contrast=None))
    with_hinge, without_weight, without = (train(views[1:], scene.means, each, views[:1]) for each in plans)
    assert without.curve[-1]["step"] <= 70
    assert with_hinge.curve[-1]["step"] == without_weight.curve[-1]["step"] == without.curve[-1]["step"] + 20
    assert (with_hinge.gaussians.sh != without_weight.gaussians.sh).any()
    assert with_hinge.decision["steps"].endswith("of 100: the validation views no longer improved")


@pytest.mark.parametrize("strategy", [CloneSplitPrune(), MultiViewConsistent(), Relocation()])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_every_strategy_copes_with_few_views(scene, views, strategy, count):
    result = train(views[:count], scene.means, TrainingPlan(steps=60, limit=600, strategy=strategy))
    assert 0 < len(result.gaussians) <= 600
    assert all(np.isfinite(value).all() for value in vars(result.gaussians).values())


def test_what_no_training_camera_sees_is_not_in_the_result(scene, views):
    behind = np.repeat(scene.means, 2, axis=0) - [0.0, 60.0, 0.0]  # the cameras stand at 78 and look towards 100
    plan = TrainingPlan(steps=20, limit=1200, strategy=CloneSplitPrune())
    result = train(views, np.concatenate([scene.means, behind]).astype(np.float32), plan)
    assert len(result.gaussians) == pytest.approx(len(scene.means), abs=40)
    assert result.gaussians.means[:, 1].min() > 78


def test_a_step_that_is_not_finite_is_skipped_counted_and_does_not_spread(scene, views):
    rasterizer = Rasterizer("cpu", 1)
    frame = SceneFrame.around(views, scene.means)
    fit = Fit(rasterizer, frame.from_world(scene), BLACK, 0.2)
    (target,) = prepare_targets(rasterizer, views[:1], frame, BLACK)
    fit.step(target, 1, TrainingPlan().learning_rates)
    assert fit.skipped == 0
    fit.parameters.sh.numpy()[5] = 1e38  # finite, but its picture is not
    before = fit.parameters.to_gaussians()
    fit.step(target, 1, TrainingPlan().learning_rates)
    assert fit.skipped == 1
    assert len(fit) == len(scene) - 1
    np.testing.assert_array_equal(fit.parameters.to_gaussians().means, np.delete(before.means, 5, axis=0))
    fit.step(target, 1, TrainingPlan().learning_rates)
    assert fit.skipped == 1
    assert all(np.isfinite(value).all() for value in vars(fit.parameters.to_gaussians()).values())


def test_skipped_steps_are_reported(scene, views):
    class Listener(Reporter):
        def __init__(self):
            self.warnings = []

        def warning(self, name, message):
            self.warnings.append((name, message))

    listener = Listener()
    colors = np.full((len(scene), 3), 128, np.uint8)
    plan = TrainingPlan(steps=5, limit=600)
    trainer = Trainer(Rasterizer("cpu"), views, [], scene.means, colors, plan, BLACK, 0)
    trainer.fit.parameters.sh.numpy()[0] = 1e38
    result = trainer.train(listener)
    assert result.skipped == 1
    assert listener.warnings[0][0] == "skipped-steps"
    assert "1 of 5 steps" in listener.warnings[0][1]
