"""What is estimated of second photographs is what second photographs of a known surface have."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from cvdgs.core.color.simulation import Observer
from cvdgs.core.evaluate.scores import Scorer
from cvdgs.core.evaluate.second_photograph import ESTIMATED_FIGURES, SecondPhotographs, resampled, views_beside

from ..consistency import scenes

OBSERVER = Observer("deutan", 1.0)
WALL = [scenes.Plane((0.0, 0.0, 1.0), 0.0)]
TEXELS = 40.0  # a unit of the wall; a pixel of the cameras is about 1.3 texels
EYES = [(0.0, 0.0, -3.0), (-0.35, 0.05, -3.0), (0.3, -0.1, -3.05)]


@pytest.fixture(scope="module")
def wall() -> Callable[[scenes.Posed], np.ndarray]:
    """A camera's noise-free picture, (H, W, 3) levels of 255, of cloth: fine colours of many strengths."""
    random = np.random.default_rng(3)
    texture = gaussian_filter(random.standard_normal((512, 512, 3)), (1.5, 1.5, 0.0), mode="wrap")
    strength = gaussian_filter(random.standard_normal((512, 512)), 12.0, mode="wrap")
    texture *= 260.0 * np.exp(1.2 * strength / strength.std())[..., None] * 0.4

    def picture(view: scenes.Posed) -> np.ndarray:
        _, depth, _, _ = scenes.render(view, WALL)
        places = TEXELS * scenes.world_points(view, depth)[..., :2]
        channels = [
            map_coordinates(texture[..., c], [places[..., 1], places[..., 0]], mode="grid-wrap") for c in range(3)
        ]
        return 128.0 + np.stack(channels, -1)

    return picture


def photographs(wall, deviation: float) -> tuple[list[np.ndarray], np.ndarray]:
    """One from each place, and a second one from the first place."""
    random = np.random.default_rng(4)
    views = [scenes.camera_at(eye, 240, 180) for eye in EYES]
    taken = [wall(view) + deviation * random.standard_normal((180, 240, 3)) for view in (*views, views[0])]
    *first, second = (np.clip(np.round(image), 0, 255).astype(np.uint8) for image in taken)
    return first, second


def seen_from_the_first(pictures: list[np.ndarray]) -> list[np.ndarray]:
    views = [scenes.camera_at(eye, 240, 180) for eye in EYES]
    _, depths, alphas, _ = scenes.render_all(views, WALL)
    found = scenes.match(depths, alphas, views, [(0, 1), (0, 2)])
    return [resampled(pictures[pair.second], pair, pictures[0].shape[:2]) for pair in found]


@pytest.mark.parametrize("deviation", [0.0, 3.0, 8.0])
def test_the_estimate_is_what_second_photographs_have(wall, deviation):
    pictures, second = photographs(wall, deviation)
    estimate = SecondPhotographs(OBSERVER)
    estimate.add(pictures[0], pictures[0], seen_from_the_first(pictures), None)
    scorer = Scorer(pictures[0], OBSERVER)
    once, twice, estimated = scorer.simulated(pictures[0]), scorer.simulated(second), estimate.figures()
    for figure in ESTIMATED_FIGURES:
        assert estimated[figure] == pytest.approx(twice[figure], abs=0.02)
    if deviation == 8.0:
        assert once["ccpr"] - twice["ccpr"] > 0.05  # so the estimate is not the photograph's own figure


def test_an_enhanced_photograph_has_an_estimate_of_its_own(wall):
    pictures, second = photographs(wall, 5.0)

    def enhanced(picture: np.ndarray) -> np.ndarray:
        """Red-green differences as lightness, which the observer sees."""
        image = picture.astype(np.float32)
        return np.clip(image + 0.8 * (image[..., :1] - image[..., 1:2]), 0, 255).astype(np.uint8)

    versions = [enhanced(picture) for picture in pictures]
    estimate = SecondPhotographs(OBSERVER)
    estimate.add(pictures[0], versions[0], seen_from_the_first(versions), None)
    scorer = Scorer(pictures[0], OBSERVER)
    truth = scorer.ccpr(enhanced(second))
    assert truth > scorer.ccpr(second) + 0.05
    assert estimate.figures()["ccpr"] == pytest.approx(truth, abs=0.02)


def test_only_what_the_mask_leaves_counts(wall):
    pictures, second = photographs(wall, 5.0)
    mask = np.ones((180, 240), bool)
    mask[:, :120] = False
    spoilt = [picture.copy() for picture in pictures]
    spoilt[0][:, :118] = np.random.default_rng(5).integers(0, 256, (180, 118, 3))
    estimate = SecondPhotographs(OBSERVER)
    estimate.add(spoilt[0], spoilt[0], seen_from_the_first(pictures), mask)
    assert estimate.figures()["ccpr"] == pytest.approx(Scorer(spoilt[0], OBSERVER, mask).ccpr(second), abs=0.02)


def test_nothing_is_estimated_where_no_other_photograph_shows_the_place(wall):
    pictures, _ = photographs(wall, 5.0)
    unseen = np.full(pictures[0].shape, np.nan, np.float32)
    estimate = SecondPhotographs(OBSERVER)
    estimate.add(pictures[0], pictures[0], [unseen, unseen], None)
    assert all(np.isnan(value) for value in estimate.figures().values())
    assert all(np.isnan(value) for value in SecondPhotographs(OBSERVER).figures().values())


def test_nothing_is_estimated_of_photographs_in_one_colour():
    plain = np.full((180, 240, 3), 90, np.uint8)
    estimate = SecondPhotographs(OBSERVER)
    estimate.add(plain, plain, seen_from_the_first([plain] * 3), None)
    assert all(np.isnan(value) for value in estimate.figures().values())


def test_a_view_is_compared_with_neighbours_on_either_side():
    views = [scenes.camera_at((x, 0.0, -3.0)) for x in (0.0, 0.1, 0.25, 0.45, 1.0)]
    assert views_beside(views, [0, 2, 3]) == {0: (1, 2), 2: (1, 3), 3: (2, 4)}
    assert views_beside(views[:2], [0]) == {}
