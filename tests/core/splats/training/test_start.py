"""What a run starts from: sparse points, or these and dense stereo, as a trial decides; and how far means move."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.raster import RasterCamera, Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import Background, prepare_targets
from cvdgs.core.splats.training.fitting import Fit
from cvdgs.core.splats.training.initialise import InitialGaussians
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.start import StartRule, StartTrial, choose_start, means_reach
from cvdgs.core.splats.training.trainer import Trainer

from ..stereo.scenes import plain, views_of_wall

BLACK = Background((0.0, 0.0, 0.0))
LIMIT = 4000
DEFAULT = StartRule(doubling_gain=0.0, few_gain=0.0)


def sparse_points(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Points on the wall and one grey for all of them."""
    places = np.random.default_rng(0).uniform([-1.5, -1.2, 0.0], [1.5, 1.2, 0.0], (count, 3))
    return places.astype(np.float32), np.full((count, 3), 128, np.uint8)


def points_on_half_a_wall(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on its left and one grey for all of them."""
    places = np.random.default_rng(0).uniform([-1.5, -1.2, 0.0], [0.0, 1.2, 0.0], (count, 3))
    return places.astype(np.float32), np.full((count, 3), 128, np.uint8)


@pytest.fixture(scope="module")
def rasterizer():
    return Rasterizer("cpu")


@pytest.fixture(scope="module")
def views():
    return views_of_wall(8, size=(64, 48))


class Rough:
    """A rough scene that is these Gaussians, in world units."""

    means_rate = 0.5

    def __init__(self, gaussians):
        self._gaussians = gaussians

    def fit(self):
        return self._gaussians


def chosen(rasterizer, views, points, rule=DEFAULT, validation=(2, 5), rough=None, goes_on=True):
    frame = SceneFrame.around(views, points[0])
    fitted = [view for i, view in enumerate(views) if i not in validation]
    targets, judging = (
        prepare_targets(rasterizer, chosen, frame, BLACK) for chosen in (fitted, [views[i] for i in validation])
    )
    rates = TrainingPlan().learning_rates
    trial = StartTrial(rasterizer, BLACK, targets, judging, 1, 100, 0.2, rates, seed=0, goes_on=goes_on)
    return choose_start(InitialGaussians(minimum=0), rule, trial, fitted, *points, frame, LIMIT, rough)


def test_where_few_points_are_known_dense_stereo_is_taken(rasterizer, views):
    choice = chosen(rasterizer, views, sparse_points())
    assert LIMIT / 3 < len(choice.gaussians) <= LIMIT / 2
    assert choice.words.startswith("dense stereo, which gained")


def test_a_gain_below_what_is_asked_for_leaves_the_sparse_points(rasterizer, views):
    choice = chosen(rasterizer, views, sparse_points(), StartRule(doubling_gain=100.0))
    assert len(choice.gaussians) == 60
    assert choice.words.startswith("sparse points")


@pytest.mark.parametrize("rule", [StartRule(dense=None), DEFAULT])
def test_nothing_is_said_where_there_is_nothing_to_choose(rasterizer, rule):
    choice = chosen(rasterizer, views_of_wall(8, colors=plain, size=(64, 48)), sparse_points(), rule)
    assert (len(choice.gaussians), choice.words) == (60, "")


@pytest.mark.parametrize(("dense", "least"), [(3001, 0.8), (5999, 0.8), (6000, 0.4), (24000, 1.2)])
def test_less_than_a_doubling_has_to_gain_more_than_one(dense, least):
    assert StartRule().least_gain(dense, 3000) == pytest.approx(least)


def test_a_few_more_points_are_refused_where_they_gain_too_little(rasterizer, views):
    points = points_on_half_a_wall(1800)
    taken = chosen(rasterizer, views, points)
    assert 1800 < len(taken.gaussians) <= 1.5 * 1800
    gain = float(taken.words.split("gained ")[1].split(" dB")[0])
    refused = chosen(rasterizer, views, points, StartRule(few_gain=gain + 0.01))
    assert len(refused.gaussians) == 1800
    assert refused.words.startswith("sparse points")


@pytest.mark.parametrize("count", [LIMIT, 3 * LIMIT])
def test_points_that_take_the_whole_limit_make_room_where_there_are_none(rasterizer, views, count):
    choice = chosen(rasterizer, views, points_on_half_a_wall(count))
    assert choice.words.startswith("dense stereo, which gained")
    places = SceneFrame.around(views, points_on_half_a_wall(count)[0]).to_world(choice.gaussians).means
    bare = np.count_nonzero(places[:, 0] > 0.2)
    assert 0.15 * LIMIT < bare < 0.4 * LIMIT
    assert len(places) <= LIMIT


def test_a_rough_scene_is_taken_only_where_validation_views_gain_by_it(rasterizer, views):
    points, nowhere = sparse_points(), replace(DEFAULT, dense=None)
    frame = SceneFrame.around(views, points[0])
    good = frame.to_world(chosen(rasterizer, views, points).gaussians)
    taken = chosen(rasterizer, views, points, nowhere, rough=Rough(good))
    assert (len(taken.gaussians), taken.means_rate) == (len(good), 0.5)
    assert taken.words.startswith("a rough scene, which gained")
    behind_the_cameras = replace(good, means=good.means - np.float32([0.0, 0.0, 20.0]))
    refused = chosen(rasterizer, views, points, nowhere, rough=Rough(behind_the_cameras))
    assert (len(refused.gaussians), refused.means_rate, refused.words) == (60, 1.0, "")


def test_a_short_run_makes_no_trial():
    assert [DEFAULT.trial_steps(steps) for steps in (5, 150, 199, 200, 3000, 30_000)] == [0, 0, 0, 100, 150, 200]


def test_without_views_that_judge_there_is_no_trial(rasterizer, views):
    choice = chosen(rasterizer, views, sparse_points(), validation=())
    assert (len(choice.gaussians), choice.words) == (60, "")


def test_the_same_seed_starts_the_same_way(rasterizer, views):
    first, second = (chosen(rasterizer, views, sparse_points()) for _ in range(2))
    np.testing.assert_array_equal(first.gaussians.means, second.gaussians.means)
    assert first.words == second.words


@pytest.mark.parametrize(
    ("rule", "most"),
    [(StartRule(doubling_gain=-100.0, few_gain=-100.0), LIMIT / 2), (StartRule(doubling_gain=100.0), LIMIT / 3)],
)
def test_a_run_starts_from_what_was_chosen_and_says_so(rasterizer, views, rule, most):
    plan = TrainingPlan(steps=500, limit=LIMIT, poses=None, exposure=None, coarse=(), start=rule)
    trainer = Trainer(rasterizer, views, [], *sparse_points(), plan, BLACK, seed=0)
    result = trainer.train(Reporter())
    assert result.initial <= most
    assert result.decision["start"].startswith("dense stereo" if rule.doubling_gain < 0.0 else "sparse points")


@pytest.mark.parametrize(("steps", "held_out", "asks"), [(300, 1, True), (1000, 1, False), (300, 0, False)])
def test_with_few_views_only_a_short_run_asks_the_held_out_ones_for_its_start(rasterizer, views, steps, held_out, asks):
    plan = TrainingPlan(steps=steps, limit=LIMIT, poses=None, exposure=None, coarse=())
    training, judging = views[:3] + views[4:], views[3:4][:held_out]
    result = Trainer(rasterizer, training, judging, *sparse_points(), plan, BLACK, seed=0).train(Reporter())
    assert ("start" in result.decision) is asks


def test_a_run_begins_after_the_steps_that_its_trial_has_made(rasterizer, views):
    refused = StartRule(doubling_gain=100.0)
    tried, untried = (
        chosen(rasterizer, views, sparse_points(), rule).gaussians for rule in (refused, replace(refused, dense=None))
    )
    targets = prepare_targets(rasterizer, views, SceneFrame.around(views, sparse_points()[0]), BLACK)
    before, after = (Fit(rasterizer, start, BLACK, 0.2).psnr(targets) for start in (untried, tried))
    assert after > before + 1.0


@pytest.mark.parametrize("rule", [DEFAULT, StartRule(doubling_gain=100.0)])
def test_a_run_that_begins_anew_chooses_alike_and_keeps_none_of_these_steps(rasterizer, views, rule):
    after, anew = (chosen(rasterizer, views, sparse_points(), rule, goes_on=goes_on) for goes_on in (True, False))
    assert anew.words == after.words
    assert len(anew.gaussians) == len(after.gaussians)
    np.testing.assert_allclose(anew.gaussians.opacities, InitialGaussians().opacity, rtol=1e-5)


def test_what_a_start_is_chosen_from_is_told_meanwhile(rasterizer, views):
    said = []

    class Listener(Reporter):
        def status(self, stage, message):
            said.append((stage, message))

    plan = TrainingPlan(steps=500, limit=LIMIT, poses=None, exposure=None, coarse=())
    Trainer(rasterizer, views, [], *sparse_points(), plan, BLACK, seed=0, reporter=Listener())
    assert [stage for stage, _ in said] == ["geometry"] * 2
    assert "7 photographs" in said[0][1]
    assert said[1][1].startswith("trying a start from 1,")


def cameras(turns: np.ndarray) -> list[RasterCamera]:
    """From the origin, turned about the vertical axis by these angles; 90 degrees wide."""
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, 0, 0] = poses[:, 2, 2] = np.cos(turns)
    poses[:, 0, 2], poses[:, 2, 0] = np.sin(turns), -np.sin(turns)
    return [RasterCamera(64, 64, 32.0, 32.0, 32.0, 32.0, pose) for pose in poses]


def test_what_every_view_shows_moves_at_the_planned_rate():
    means = np.array([[0.0, 0.0, 2.0], [0.2, 0.1, 3.0]], np.float32)
    assert means_reach(means, cameras(np.zeros(5))) == 1.0


def test_what_a_fourth_of_the_views_show_moves_four_times_as_fast():
    angles = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    ring = np.stack([np.cos(angles), np.zeros(400), np.sin(angles)], axis=1).astype(np.float32)
    assert means_reach(ring, cameras(angles[::10] + 1e-3)) == pytest.approx(4.0, rel=0.05)


def test_what_no_view_shows_has_a_finite_rate():
    behind = np.array([[0.0, 0.0, -2.0]], np.float32)
    assert 1.0 < means_reach(behind, cameras(np.zeros(5))) < 100.0
    assert means_reach(behind[:0], cameras(np.zeros(5))) == 1.0
