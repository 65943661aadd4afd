"""Recipes are tried on the same photographs and points, share what they have in common, and drift tells them apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import Capture, View
from cvdgs.core.evaluate.evaluation import SceneMatches
from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.baselines import PerViewLut
from cvdgs.scripts.benchmarks.enhancers.drift import reconstruct_matches
from cvdgs.scripts.benchmarks.studies.captures import Subject
from cvdgs.scripts.benchmarks.studies.recipe import PLAIN, Recipe, Trial, recipe_enhancer
from cvdgs.scripts.benchmarks.studies.table import compare
from cvdgs.scripts.benchmarks.studies.trials import CaptureTrials
from cvdgs.scripts.benchmarks.tables import frame_of

from ....core.splats.training.test_trainer import photographs, wall

DRIFT = 40.0  # degrees of hue
STEPS = 120


def capture_of_a_wall() -> Capture:
    scene = wall(300)
    views = tuple(replace(view, source=Path("wall")) for view in photographs(scene, 8))
    return Capture(Path("wall"), "test", views, scene.means, np.full((300, 3), 128, np.uint8))


@pytest.fixture(scope="module")
def trials(tmp_path_factory) -> CaptureTrials:
    capture = capture_of_a_wall()
    subject = Subject.of(capture, holdout=5)
    return CaptureTrials("wall", subject, reconstruct_matches(capture, 200), tmp_path_factory.mktemp("wall"))


@pytest.fixture(scope="module")
def drifting(trials) -> dict[str, Trial]:
    recipe = Recipe("", enhancer="none", drift=DRIFT, iterations=STEPS, gaussians=500)
    return {mode: trials.try_recipe(replace(recipe, label=mode, mode=mode)) for mode in ("post", "joint", "layers")}


@pytest.mark.slow
def test_what_is_enhanced_afterwards_drifts_and_what_is_fitted_to_all_views_does_not(drifting):
    post = drifting["post"]
    assert post.rwe > 2.0 * post.rwe_unenhanced
    found = compare(frame_of(Trial, list(drifting.values())).assign(name="drifting"))
    assert found["mode"].tolist() == ["joint", "layers"]
    assert (found.rwe_ratio < 0.38).all()
    assert (found.added_ratio < found.rwe_ratio).all()


def test_drift_is_found_in_the_enhanced_photographs(trials, drifting):
    steady = trials.try_recipe(Recipe("steady", enhancer="none", iterations=STEPS, gaussians=500))
    assert steady.rwe_enhanced == 1.0
    assert drifting["post"].rwe_enhanced > 2.0


def test_the_modes_are_measured_on_the_same_photographs_and_points(drifting):
    for name in ("ccpr_input", "ccpr_enhanced", "rwe_enhanced"):
        assert len({getattr(trial, name) for trial in drifting.values()}) == 1


def test_layers_and_post_share_a_geometry_and_joint_has_its_own(drifting):
    assert drifting["layers"].gaussians == drifting["post"].gaussians
    assert drifting["layers"].geometry_seconds == drifting["post"].geometry_seconds
    assert drifting["layers"].psnr == drifting["post"].psnr
    assert drifting["joint"].geometry_seconds != drifting["layers"].geometry_seconds


def test_a_trial_says_whether_the_views_that_it_is_judged_on_decided_about_it(trials, drifting):
    assert drifting["layers"].decided_on_held_out  # 6 training views are too few to hold one back
    plain = Recipe("plain", enhancer="none", iterations=20, gaussians=500, plans=PLAIN)
    assert not trials.try_recipe(plain).decided_on_held_out  # there is nothing to decide


def test_severity_zero_changes_nothing(trials):
    nobody = Layer("deutan", 0.0)
    found, none = (
        trials.try_recipe(Recipe(name, enhancer=name, layer=nobody, iterations=STEPS, gaussians=500))
        for name in ("lut", "none")
    )
    assert found.delta_e == pytest.approx(0.0, abs=1e-9)  # equal images, but for rounding
    assert found.natural_ssim == pytest.approx(1.0)
    assert found.rwe_enhanced == 1.0
    for name in ("ccpr", "rwe", "psnr", "psnr_to_enhanced"):
        assert getattr(found, name) == getattr(none, name)


@pytest.mark.parametrize("name", ["lut", "lut-per-view", "fidaner"])
def test_an_enhancer_is_fitted_with_the_seed_of_its_recipe(name):
    image, found = np.random.default_rng(0).integers(0, 256, (24, 24, 3), np.uint8), {}
    recipes = [Recipe(str(seed), enhancer=name, seed=seed) for seed in (0, 1)]
    for recipe in recipes:
        enhancer = recipe_enhancer(recipe)
        enhancer.fit([image])
        found[recipe.enhancement_key] = enhancer(image)
    assert len(found) == 2  # neither is taken for the other's
    assert np.array_equal(*found.values()) == (name == "fidaner")  # nothing in that one is random


def test_a_lut_of_its_own_gives_one_colour_another_result_in_another_image():
    rng = np.random.default_rng(0)
    red_and_green = np.where(rng.random((24, 24, 1)) < 0.5, [180, 60, 50], [90, 110, 40]).astype(np.uint8)
    enhancer = PerViewLut("deutan", 1.0, "machado")
    enhancer.fit([red_and_green])
    first = enhancer(red_and_green)
    for step in range(1, 7):  # each of them throws a coin of its own, and one will fall on the other side
        other = red_and_green.copy()
        other[0, 0] += np.array([step, 0, 0], np.uint8)
        difference = np.abs(first - enhancer(other))[1:].mean()
        if difference > 0.01:
            break
    assert difference > 0.01


def half_as_large(view: View) -> View:
    height, width = view.image.shape[0] // 2, view.image.shape[1] // 2
    image = view.image.reshape(height, 2, width, 2, 3).mean(axis=(1, 3)).astype(np.uint8)
    return replace(view, image=image, camera=view.camera.scaled(width, height))


def test_a_scene_of_smaller_photographs_is_judged_on_views_that_were_not_matched(tmp_path):
    judged = Subject.of(capture_of_a_wall(), holdout=5)
    small = replace(judged.given, views=tuple(half_as_large(view) for view in judged.given.views))
    subject = Subject(small, judged.split, judged.judged, judged.judged_split)
    trials = CaptureTrials("wall", subject, SceneMatches([0, 1], [], []), tmp_path)
    assert trials.try_recipe(Recipe("small", enhancer="none", iterations=STEPS, gaussians=500)).psnr > 20.0
