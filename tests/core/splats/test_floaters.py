"""Floaters get high scores and sound Gaussians low ones; cleaning removes what it says, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cvdgs.core.capture.reader import read_capture
from cvdgs.core.errors import InputError
from cvdgs.core.evaluate.evaluation import Split
from cvdgs.core.pipeline.cleaning import clean, look
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.floaters import Sightings, floater_scores, kept_after
from cvdgs.core.splats.gaussians import SH_C0, Gaussians, core_bounds
from cvdgs.core.splats.io.files import read_gaussians, without_floaters
from cvdgs.core.splats.io.ply import read_floaters, write_ply
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer
from cvdgs.core.splats.targets import Background
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.trainer import Trainer

from ...few_views import write_few_views

MIDDLE = 0.5
_COUNT = 12


def some(count: int = 300, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    return Gaussians(
        means=rng.uniform(-1, 1, (count, 3)).astype(np.float32),
        log_scales=np.log(rng.uniform(0.02, 0.1, (count, 3))).astype(np.float32),
        quaternions=rng.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=np.full(count, 2.0, np.float32),
        sh=rng.uniform(-1, 1, (count, 1, 3)).astype(np.float32),
    )


def finite(shape, low: float, high: float):
    return arrays(np.float32, shape, elements=st.floats(low, high, width=32))


@given(
    means=finite((_COUNT, 3), -1e6, 1e6),
    log_scales=finite((_COUNT, 3), -30, 30),
    seen=arrays(np.int32, _COUNT, elements=st.integers(0, 40)),
    pixels=finite(_COUNT, 0, 1e6),
    nearness=arrays(np.float32, _COUNT, elements=st.floats(0, np.inf, width=32)),
    amounts=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_scores_are_shares_and_more_cleaning_removes_no_fewer(
    means, log_scales, seen, pixels, nearness, amounts
) -> None:
    gaussians = replace(some(_COUNT), means=means, log_scales=log_scales)
    for sightings in (None, Sightings(40, seen, pixels, nearness)):
        scores = floater_scores(gaussians, sightings)
        assert scores.shape == (_COUNT,)
        assert ((scores >= 0.0) & (scores <= 1.0)).all()
        less, more = (kept_after(scores, amount) for amount in sorted(amounts))
        assert (less | ~more).all()
        assert kept_after(scores, 0.0).all()
        assert np.array_equal(kept_after(scores, 1.0), scores == 0.0)


@pytest.mark.parametrize(("radii", "score"), [(2.5, 0.0), (5.0, 0.5), (10.0, 1.0), (40.0, 1.0)])
def test_a_gaussian_far_outside_scores_by_its_distance(radii: float, score: float) -> None:
    gaussians = some()
    center, radius = core_bounds(gaussians.means)
    gaussians.means[0] = center + np.array([radii * radius, 0.0, 0.0])
    center, radius = core_bounds(gaussians.means)
    gaussians.means[0] = center + np.array([radii * radius, 0.0, 0.0])
    assert floater_scores(gaussians)[0] == pytest.approx(score, abs=0.01)
    assert not floater_scores(gaussians)[1:].any()


@pytest.mark.parametrize(
    ("length", "width", "score"),
    [(1 / 3, 1 / 600, 1.0), (0.1054, 0.1054 / 40, 0.5), (0.01, 0.0001, 0.0), (1, 0.2, 0.0)],
)
def test_a_needle_is_both_slender_and_long(length: float, width: float, score: float) -> None:
    """Standard deviations in radii of the scene."""
    gaussians = some()
    radius = core_bounds(gaussians.means)[1]
    gaussians.log_scales[0] = np.log(np.array([width, length, width / 2]) * radius)
    assert floater_scores(gaussians)[0] == pytest.approx(score, abs=0.01)


@pytest.mark.parametrize(
    ("seen", "pixels", "nearness", "score"),
    [(9, 0.25, 1.0, 0.0), (9, 0.05, 1.0, 0.5), (0, 0.0, np.inf, 1.0), (2, 9.0, 0.3, 0.5), (3, 9.0, 0.1, 0.0)],
)
def test_what_hardly_a_view_shows_scores_by_what_they_show(seen, pixels, nearness, score: float) -> None:
    gaussians = some()
    count = len(gaussians)
    sightings = Sightings(20, np.full(count, 20), np.full(count, 9.0), np.full(count, 1.0))
    sightings.seen[0], sightings.pixels[0], sightings.nearness[0] = seen, pixels, nearness
    scores = floater_scores(gaussians, sightings)
    assert scores[0] == pytest.approx(score, abs=0.01)
    assert not scores[1:].any()


def test_of_few_views_one_may_show_something_alone() -> None:
    gaussians = some()
    count = len(gaussians)
    sightings = Sightings(7, np.ones(count, np.int32), np.full(count, 9.0), np.full(count, 0.1))
    assert not floater_scores(gaussians, sightings).any()


def test_a_file_keeps_the_scores_and_any_program_reads_its_gaussians(tmp_path: Path) -> None:
    gaussians, scores = some(), np.linspace(0, 1, 300, dtype=np.float32)
    write_ply(tmp_path / "with.ply", gaussians, scores)
    write_ply(tmp_path / "without.ply", gaussians)
    found = read_floaters(tmp_path / "with.ply")
    assert found is not None
    assert np.array_equal(found, scores)
    assert read_floaters(tmp_path / "without.ply") is None
    for name, values in vars(read_gaussians(tmp_path / "with.ply")).items():
        assert np.array_equal(values, getattr(gaussians, name)), name


def test_recorded_scores_decide_what_is_left_out_of_every_layer(tmp_path: Path) -> None:
    gaussians, scores = some(), np.linspace(0, 1, 300, dtype=np.float32)
    path = tmp_path / "splats.ply"
    write_ply(path, gaussians, scores)
    layers = {"original": gaussians, "other": gaussians.with_base_colors(1.0 - gaussians.base_colors)}
    left = without_floaters(layers, [path], 0.25)
    assert [len(layer) for layer in left.values()] == [int((scores <= 0.75).sum())] * 2
    assert np.array_equal(left["other"].sh, layers["other"].sh[scores <= 0.75])


def test_damaged_scores_are_refused(tmp_path: Path) -> None:
    write_ply(tmp_path / "splats.ply", some(), np.full(300, np.nan, np.float32))
    with pytest.raises(InputError, match="holds no scores from 0 to 1"):
        read_floaters(tmp_path / "splats.ply")


def test_nothing_left_is_refused(tmp_path: Path) -> None:
    write_ply(tmp_path / "splats.ply", some(), np.full(300, 1.0, np.float32))
    with pytest.raises(InputError, match="nothing would be left"):
        without_floaters({"original": some()}, [tmp_path / "splats.ply"], 1.0)


def planted(scene: Gaussians, cameras: np.ndarray, of_each: int, seed: int = 1) -> Gaussians:
    """`scene` followed by floaters: far outside, needles, too faint to see, right before a camera."""
    rng = np.random.default_rng(seed)
    center, radius = core_bounds(scene.means)
    count = 4 * of_each
    directions = rng.standard_normal((of_each, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    far = center + directions * radius * rng.uniform(6, 20, (of_each, 1))
    inside = center + rng.uniform(-0.7, 0.7, (of_each, 3)) * radius
    faint = scene.means[rng.integers(0, len(scene), of_each)]
    owners = cameras[np.arange(of_each) % len(cameras)]
    before = owners + (center - owners) * rng.uniform(0.05, 0.12, (of_each, 1))
    scales = np.full((count, 3), 0.01 * radius)
    scales[of_each : 2 * of_each] = radius * np.array([0.4, 0.4 / 120, 0.4 / 200])
    scales[3 * of_each :] = 3e-3 * radius
    floaters = Gaussians(
        means=np.concatenate([far, inside, faint, before]).astype(np.float32),
        log_scales=np.log(scales).astype(np.float32),
        quaternions=rng.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=np.repeat([1.0, 1.0, -6.0, 1.0], of_each).astype(np.float32),
        sh=np.resize((rng.uniform(0, 1, (count, 1, 3)) - 0.5) / SH_C0, (count, scene.sh.shape[1], 3)).astype(
            np.float32
        ),
    )
    return Gaussians(
        **{name: np.concatenate([values, getattr(floaters, name)]) for name, values in vars(scene).items()}
    )


def test_planted_floaters_are_found_and_the_scene_is_left_alone(tmp_path: Path) -> None:
    """A small scene of the demo's photographs."""
    capture = read_capture(write_few_views(tmp_path / "capture", 20, 0.25), max_size=None)
    split, rasterizer = Split.every(len(capture.views)), Rasterizer("cpu")
    training, held_out = ([capture.views[i] for i in part] for part in (split.train, split.test))
    background = Background.of(training)
    plan = TrainingPlan(steps=300, limit=3000)
    trainer = Trainer(rasterizer, training, held_out, capture.points, capture.point_colors, plan, background, 0)
    scene = trainer.train(Reporter()).gaussians
    renderer = SceneRenderer(rasterizer, capture.views, background)
    full = planted(scene, np.stack([view.center for view in training]), 50)

    alone = clean(scene, look(rasterizer, scene, training, background), MIDDLE, renderer, split.test)
    result = clean(full, look(rasterizer, full, training, background), MIDDLE, renderer, split.test)
    scores = floater_scores(full, look(rasterizer, full, training, background))
    removed = ~kept_after(scores, MIDDLE)
    assert removed[len(scene) :].mean() >= 0.95
    assert removed[: len(scene)].mean() <= 0.005
    assert result.figures["removed"] == removed.sum()
    assert result.figures["psnr_after"] > result.figures["psnr_before"]
    assert alone.figures["psnr_after"] >= alone.figures["psnr_before"] - 0.05
    assert result.figures["psnr_after"] >= alone.figures["psnr_before"] - 0.05
    assert len(result.scores) == len(result.gaussians)
