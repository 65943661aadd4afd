"""The rough scene that comes first where a run is too short for its scene: when, of what, and what becomes of it."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.targets import Background
from cvdgs.core.splats.training.joint import JointPlan, JointTraining
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.rough import RoughScene, rough_fit
from cvdgs.core.splats.training.trainer import Trainer

from ..stereo.scenes import views_of_wall

BLACK, RED = Background((0.0, 0.0, 0.0)), Background((1.0, 0.0, 0.0))
ALWAYS = RoughScene(visits=10**6, side=32, steps=1.0)
PLAN = TrainingPlan(steps=500, limit=2000, poses=None, exposure=None, coarse=(), rough=ALWAYS)


def sparse_points() -> tuple[np.ndarray, np.ndarray]:
    """Points on the wall and one grey for all of them."""
    places = np.random.default_rng(0).uniform([-1.5, -1.2, 0.0], [1.5, 1.2, 0.0], (200, 3))
    return places.astype(np.float32), np.full((200, 3), 128, np.uint8)


@pytest.fixture(scope="module")
def views():
    return views_of_wall(8, size=(96, 72))


class Listener(Reporter):
    def __init__(self):
        self.said, self.fractions = [], []
        self.shown = []
        self._gaussians = None

    def scene(self, gaussians):
        self._gaussians = gaussians

    def status(self, stage, message):
        self.said.append(message)

    def progress(self, stage, fraction, message=""):
        self.fractions.append(fraction)
        if self._gaussians is not None:
            self.shown.append(self._gaussians())


def asked_of_a_fit(views, plan=PLAN, background=BLACK):
    """The views and the plan that the rough scene of a run by `plan` is fitted by."""
    asked = []

    def train(small, rough_plan, reporter):
        asked.append((small, rough_plan))
        return Gaussians.none()

    rough_fit(plan, 2.0, views, background, train, Reporter(), "geometry").fit()
    return asked[0]


@pytest.mark.parametrize(
    ("steps", "reach", "rough"), [(3000, 1.1, 0), (3000, 7.0, 5010), (7000, 7.0, 0), (440, 1.0, 735)]
)
def test_a_run_in_which_a_gaussian_is_in_few_steps_has_a_rough_scene(steps, reach, rough):
    assert RoughScene().steps_before(steps, reach) == rough


def test_small_photographs_and_runs_without_a_rough_scene_get_none(views):
    assert rough_fit(replace(PLAN, rough=replace(ALWAYS, side=64)), 2.0, views, BLACK, None, Reporter(), "") is None
    assert rough_fit(replace(PLAN, rough=None), 2.0, views, BLACK, None, Reporter(), "") is None
    assert rough_fit(PLAN, 2.0, [], BLACK, None, Reporter(), "") is None


def test_strips_keep_16_rows(views):
    strips = [replace(view, image=view.image[:34], camera=replace(view.camera, height=34)) for view in views]
    assert asked_of_a_fit(strips)[0][0].image.shape == (17, 48, 3)
    thin = [replace(view, image=view.image[:20], camera=replace(view.camera, height=20)) for view in views]
    assert rough_fit(PLAN, 2.0, thin, BLACK, None, Reporter(), "") is None


def test_small_photographs_show_the_same_from_the_same_places(views):
    small, _ = asked_of_a_fit(views)
    for view, reduced in zip(views, small, strict=True):
        assert reduced.image.shape == (24, 32, 3)
        np.testing.assert_array_equal(reduced.world_to_camera, view.world_to_camera)
        corner = view.image[:3, :3].reshape(-1, 3).mean(0)
        np.testing.assert_allclose(reduced.image[0, 0], corner, atol=0.5)
        assert reduced.camera.fx == view.camera.fx / 3
        assert reduced.camera.cx == view.camera.cx / 3


def test_what_is_not_looked_at_is_not_looked_at_in_small_photographs(views):
    mask = np.ones((72, 96), bool)
    mask[:10] = False
    small, _ = asked_of_a_fit([replace(views[0], mask=mask)])
    assert not small[0].mask[:4].any()  # a block that the edge of the mask cuts counts as not looked at
    assert small[0].mask[4:].all()


def test_a_cut_out_is_reduced_over_its_background(views):
    cut = replace(views[0], alpha=np.zeros((72, 96), np.uint8))
    small, _ = asked_of_a_fit([cut], background=RED)
    np.testing.assert_array_equal(small[0].image[0, 0], [255, 0, 0])


def test_a_rough_scene_has_no_more_gaussians_than_small_photographs_determine(views):
    assert asked_of_a_fit(views, replace(PLAN, limit=100_000))[1].limit == 1000
    assert asked_of_a_fit(views, replace(PLAN, limit=500))[1].limit == 500
    assert asked_of_a_fit(views, replace(PLAN, limit=None))[1].limit is None


def test_a_run_starts_from_its_rough_scene_and_says_so(views):
    listener, plan = Listener(), replace(PLAN, rough=replace(ALWAYS, side=48))
    trainer = Trainer(Rasterizer("cpu"), views, [], *sparse_points(), plan, BLACK, 0, reporter=listener)
    assert any("a rough scene to photographs of 48 pixels" in message for message in listener.said)
    result = trainer.train(listener)
    assert result.decision["start"].startswith("a rough scene, which gained")
    assert listener.fractions == sorted(listener.fractions)  # as one stage, which never goes back
    assert listener.fractions[-1] == 1.0


def test_while_a_rough_scene_is_fitted_it_can_be_watched(views):
    listener, plan = Listener(), replace(PLAN, rough=replace(ALWAYS, side=48))
    Trainer(Rasterizer("cpu"), views, [], *sparse_points(), plan, BLACK, 0, reporter=listener)
    first, last = listener.shown[0], listener.shown[-1]
    assert np.ptp(first.means, axis=0).max() < 10.0  # in world units
    first, last = np.ptp(first.base_colors, axis=1), np.ptp(last.base_colors, axis=1)
    assert last.mean() > 2.0 * first.mean()  # the points are grey, the wall is not


def test_the_progress_of_joint_training_does_not_step_back_when_its_rough_scene_ends(views):
    listener, plan = Listener(), replace(PLAN, sh_degree=0, steps=640, rough=replace(ALWAYS, side=48))
    training = JointTraining(Rasterizer("cpu", 1), views, [], plan, JointPlan(), BLACK, 0)
    result = training.train(*sparse_points(), lambda _: None, listener)
    assert any("a rough scene to photographs of 48 pixels" in message for message in listener.said)
    assert listener.fractions == sorted(listener.fractions)
    np.testing.assert_array_equal(listener.shown[-1].means, result.gaussians.means)  # watched to the end


def test_where_no_views_can_judge_there_is_no_rough_scene(views):
    listener = Listener()
    Trainer(Rasterizer("cpu"), views[:7], [], *sparse_points(), PLAN, BLACK, 0, reporter=listener)
    assert not any("rough" in message for message in listener.said)
