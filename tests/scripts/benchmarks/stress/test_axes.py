"""Every level of stress does what it says, and the harmless one nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from copy import copy
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from colour import XYZ_to_Lab, sRGB_to_XYZ

from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.color.srgb import decode
from cvdgs.scripts.benchmarks.stress.axes import AXES, HARMLESS, LEVELS, Axis, PerturbedCapture
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder, Subject
from cvdgs.scripts.benchmarks.studies.recipe import Recipe

BY_NAME = {axis.name: axis for axis in AXES}
BROKEN = range(HARMLESS + 1, LEVELS)
WIDTH, HEIGHT = 48, 32
KEY = """
import sys
from pathlib import Path
from cvdgs.scripts.benchmarks.stress.axes import AXES, PerturbedCapture
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder
(axis,) = (axis for axis in AXES if axis.name == "poses")
sys.stdout.write(PerturbedCapture(CaptureFolder("empty", Path(sys.argv[1]), 100), axis, 2, 0).key)
"""


@pytest.fixture(scope="module")
def subject() -> Subject:
    """Forty views of smooth colours and edges."""
    rng = np.random.default_rng(1)
    views = []
    for index in range(40):
        coarse = rng.uniform(40, 200, (4, 6, 3))
        image = np.kron(coarse, np.ones((8, 8, 1))).astype(np.uint8)
        pose = np.eye(4)
        pose[0, 3] = 0.1 * index
        camera = PinholeCamera(WIDTH, HEIGHT, 50.0, 50.0, WIDTH / 2, HEIGHT / 2)
        views.append(View(f"view_{index:03}", Path(f"view_{index:03}.png"), camera, pose, image))
    points, colors = rng.normal(size=(200, 3)).astype(np.float32), rng.integers(0, 256, (200, 3), np.uint8)
    return Subject.of(Capture(Path("made"), "transforms", tuple(views), points, colors))


def images(capture: Capture) -> np.ndarray:
    return np.stack([view.image for view in capture.views]).astype(float)


def change(subject: Subject, name: str, level: int) -> float:
    """Mean difference of the given photographs to the untouched ones."""
    return float(np.abs(images(BY_NAME[name].apply(subject, level, 0).given) - images(subject.given)).mean())


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_the_harmless_level_changes_nothing(subject: Subject, axis: Axis) -> None:
    assert axis.apply(subject, HARMLESS, 0) is subject
    assert axis.recipe(Recipe("any"), HARMLESS) == Recipe("any")


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_an_axis_changes_the_capture_or_the_recipe_or_the_scene(axis: Axis) -> None:
    assert sum(map(bool, (axis.perturb, axis.perturb_subject, axis.vary, axis.scene_option))) == 1


@pytest.mark.parametrize(
    "axis", [axis for axis in AXES if axis.perturb or axis.name == "views"], ids=lambda axis: axis.name
)
def test_the_judged_capture_is_not_perturbed(subject: Subject, axis: Axis) -> None:
    for level in BROKEN:
        stressed = axis.apply(subject, level, 0)
        assert stressed.judged is subject.judged
        assert stressed.judged_split == subject.judged_split


def test_photographs_get_fewer_and_none_is_a_judged_one(subject: Subject) -> None:
    judges = {subject.judged.views[index].key for index in subject.judged_split.test}
    for level in BROKEN:
        stressed = BY_NAME["views"].apply(subject, level, 0)
        assert len(stressed.given.views) == BY_NAME["views"].value(level)
        assert judges.isdisjoint(view.key for view in stressed.given.views)
        assert len(stressed.split.train) + len(stressed.split.test) == len(stressed.given.views)


def test_cameras_are_turned_by_the_angle_and_stay_where_they_are(subject: Subject) -> None:
    for level in BROKEN:
        given = BY_NAME["poses"].apply(subject, level, 3).given
        for view, before in zip(given.views, subject.given.views, strict=True):
            turn = view.world_to_camera[:3, :3] @ before.world_to_camera[:3, :3].T
            angle = np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
            assert angle == pytest.approx(BY_NAME["poses"].value(level), rel=1e-6)
            np.testing.assert_allclose(view.center, before.center, atol=1e-12)


def test_focal_lengths_are_too_long_by_the_share(subject: Subject) -> None:
    for level in BROKEN:
        camera = BY_NAME["intrinsics"].apply(subject, level, 0).given.views[0].camera
        assert camera.fx == pytest.approx(50.0 * (1.0 + BY_NAME["intrinsics"].value(level)))
        assert (camera.width, camera.cx) == (WIDTH, WIDTH / 2)


def test_points_get_fewer_until_none_is_left(subject: Subject) -> None:
    counts = [len(BY_NAME["points"].apply(subject, level, 0).given.points) for level in BROKEN]
    assert counts == [20, 6, 2, 0]
    assert "no-points" in {w.name for w in BY_NAME["points"].apply(subject, 4, 0).given.warnings}


def test_exposures_vary_by_the_stops_and_their_mean_stays(subject: Subject) -> None:
    # Dark enough that nothing is clipped: green carries the exposure alone.
    dark = replace(subject.given, views=tuple(replace(v, image=v.image // 4 + 20) for v in subject.given.views))
    axis = BY_NAME["exposure"]
    given = axis.apply(replace(subject, given=dark), 2, 5).given
    before, after = (decode(images(capture)[..., 1] / 255.0).mean(axis=(1, 2)) for capture in (dark, given))
    stops = np.log2(after / before)
    assert stops.std() == pytest.approx(axis.value(2), rel=0.35)  # of forty draws
    assert stops.mean() == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("name", ["exposure", "blur", "jpeg", "light", "saturation"])
def test_photographs_get_ever_worse(subject: Subject, name: str) -> None:
    changes = [change(subject, name, level) for level in BROKEN]
    assert changes[0] > 0.0
    assert changes == sorted(changes)


def test_the_noise_of_little_light_is_that_of_counted_photons(subject: Subject) -> None:
    grey = replace(
        subject.given, views=tuple(replace(v, image=np.full_like(v.image, 128)) for v in subject.given.views)
    )
    axis = BY_NAME["light"]
    light = decode(images(axis.apply(replace(subject, given=grey), 1, 0).given) / 255.0)
    electrons = 10_000 / 2.0 ** axis.value(1)
    assert light.mean() == pytest.approx(decode(128 / 255), rel=0.01)
    assert light.std() == pytest.approx(np.sqrt(decode(128 / 255) * electrons + 9.0) / electrons, rel=0.03)


def test_chroma_is_multiplied_where_the_display_can_show_it(subject: Subject) -> None:
    pale = np.array([[[120, 130, 126]]], np.uint8).repeat(16, 0).repeat(16, 1)
    scene = replace(subject.given, views=tuple(replace(view, image=pale) for view in subject.given.views))
    given = BY_NAME["saturation"].apply(Subject.of(scene), 2, 0).given
    before, after = (XYZ_to_Lab(sRGB_to_XYZ(view.image[0, 0] / 255.0)) for view in (scene.views[0], given.views[0]))
    np.testing.assert_allclose(after[1:], 2.0 * before[1:], atol=0.7)  # of whole levels
    assert after[0] == pytest.approx(before[0], abs=0.4)


def test_recipes_drift_and_grow_milder_as_the_level_says() -> None:
    drifting = [BY_NAME["drift"].recipe(Recipe("any"), level) for level in BROKEN]
    assert [recipe.drift for recipe in drifting] == [5.0, 15.0, 45.0, 0.0]
    assert [recipe.enhancer for recipe in drifting] == ["scene", "scene", "scene", "lut-per-view"]
    severities = [BY_NAME["severity"].recipe(Recipe("any"), level).layer.severity for level in BROKEN]
    assert severities == [0.75, 0.5, 0.25, 0.0]


def test_a_perturbed_capture_is_the_same_in_another_process_and_differs_by_seed_and_level(tmp_path: Path) -> None:
    base = CaptureFolder("empty", tmp_path, 100)
    first = PerturbedCapture(base, BY_NAME["poses"], 2, 0)
    command = [sys.executable, "-c", KEY, str(tmp_path)]
    other = subprocess.run(command, env={**os.environ, "PYTHONHASHSEED": "7"}, capture_output=True, text=True)
    assert other.stdout == first.key, other.stderr
    assert len({first.key, replace(first, level=3).key, replace(first, seed=1).key}) == 3


def test_perturbed_captures_can_be_sent_to_another_process(tmp_path: Path) -> None:
    sent = [PerturbedCapture(CaptureFolder("empty", tmp_path, 100), axis, 2, 0) for axis in AXES]
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert list(pool.map(copy, sent)) == sent


@pytest.mark.parametrize("name", ["poses", "exposure", "light"])
def test_perturbations_differ_by_seed_and_not_by_call(subject: Subject, name: str) -> None:
    def given(seed: int) -> np.ndarray:
        capture = BY_NAME[name].apply(subject, 2, seed).given
        poses = np.stack([view.world_to_camera for view in capture.views])
        return np.concatenate([images(capture).ravel(), poses.ravel()])

    np.testing.assert_array_equal(given(0), given(0))
    assert not np.array_equal(given(0), given(1))
