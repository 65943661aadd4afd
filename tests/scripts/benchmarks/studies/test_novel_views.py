"""Novel views lie between held-out cameras, and the figure finds where the modes disagree."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cvdgs.core.files.images import read_png
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmarks.studies.captures import Subject
from cvdgs.scripts.benchmarks.studies.figure import Choice, shaping, strip, write_figure
from cvdgs.scripts.benchmarks.studies.novel_views import (
    COMPARED,
    ORIGINAL,
    NovelViews,
    cached_novel_views,
    camera_path,
    least_steady_step,
    novel_views,
    window_of_disagreement,
)
from cvdgs.scripts.benchmarks.studies.recipe import DEUTAN, Recipe

from .test_trials import capture_of_a_wall

GREY = np.full((40, 60, 3), 120, np.uint8)


def painted(row: int, column: int, color: tuple[int, int, int]) -> np.ndarray:
    image = GREY.copy()
    image[row : row + 10, column : column + 10] = color
    return image


@pytest.fixture
def made() -> NovelViews:
    """Six cameras; `post` has a patch at (20, 30) that turns from red to green between the third and the fourth."""
    flickering = [painted(20, 30, (200, 60, 60) if camera < 3 else (60, 200, 60)) for camera in range(6)]
    steady = [painted(20, 30, (130, 130, 60))] * 6
    pictures = {ORIGINAL: [GREY] * 6, "post": flickering, "joint": steady, "layers": steady}
    return NovelViews(("view_000", "view_008"), pictures)


def test_a_path_leads_evenly_from_one_camera_to_the_other():
    first, second = capture_of_a_wall().views[:2]
    centers = [first.center, *(view.center for view in camera_path(first, second, 4)), second.center]
    steps = [np.linalg.norm(after - before) for before, after in pairwise(centers)]
    np.testing.assert_allclose(steps, np.linalg.norm(second.center - first.center) / 5, rtol=1e-9)
    for view in camera_path(first, second, 4):
        np.testing.assert_allclose(view.world_to_camera[:3, :3] @ view.world_to_camera[:3, :3].T, np.eye(3), atol=1e-12)


def test_pictures_of_a_network_are_made_anew_with_other_weights(tmp_path):
    weights = tmp_path / "mine.safetensors"
    weights.write_bytes(b"first")
    first = shaping(Recipe("any", enhancer=str(weights)), 6)
    weights.write_bytes(b"other")
    assert shaping(Recipe("any", enhancer=str(weights)), 6) != first


def test_the_step_where_post_flickers_is_found(made):
    assert least_steady_step(made.pictures, "post", "layers") == 2


def test_the_window_holds_what_the_modes_disagree_about(made):
    row, column = window_of_disagreement(made.pictures, (2, 3), side=14)
    assert row <= 20
    assert row + 14 >= 30
    assert column <= 30
    assert column + 14 >= 40


def test_a_strip_has_a_slice_of_every_picture_in_order():
    pictures = [np.full((4, 9, 3), shade, np.uint8) for shade in (10, 20, 30)]
    found = strip(pictures, Choice(0, (0, 0), 2, slice=(3, 2)))
    assert found.shape == (4, 6, 3)
    assert found[0, :, 0].tolist() == [10, 10, 20, 20, 30, 30]


def test_the_figure_is_written_in_light_and_dark(made, tmp_path):
    choice = write_figure(tmp_path, "figure", made, DEUTAN, "machado", "A title")
    assert choice.camera == 2
    light, dark = (read_png(tmp_path / f"figure{suffix}.png") for suffix in ("", "-dark"))
    assert light.shape == dark.shape
    assert light[2, 2].mean() > 200 > 50 > dark[2, 2].mean()


def test_the_modes_are_rendered_once_and_kept(tmp_path):
    recipe = Recipe("figure", enhancer="none", drift=40.0, iterations=60, gaussians=400)
    subject = Subject.of(capture_of_a_wall(), holdout=3)
    calls = []

    def make() -> NovelViews:
        calls.append(1)
        return novel_views("wall", subject, recipe, 3, tmp_path / "runs", Reporter())

    first, second = (cached_novel_views(tmp_path / "kept", make) for _ in range(2))
    assert len(calls) == 1
    assert first.between == second.between == ("03", "06")
    for name in (ORIGINAL, *COMPARED):
        np.testing.assert_array_equal(first.pictures[name], second.pictures[name])
        assert len(first.pictures[name]) == 3
    # The enhancer turns hues by another angle in every picture; a layer has one colour a Gaussian.
    assert first.pictures["post"][0].tobytes() != first.pictures["layers"][0].tobytes()
