"""Photographs of one scene stay together, whatever sides of it they show; unrelated ones are told apart."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from PIL import Image

from cvdgs.core.demo import SHOWROOM
from cvdgs.core.photographs.groups import group_by_palette
from cvdgs.scripts.training.data.plates import draw_plate

SIDE = 96


@lru_cache
def demo() -> list[np.ndarray]:
    images = []
    for path in sorted((SHOWROOM / "images").iterdir()):
        with Image.open(path) as picture:
            picture.thumbnail((SIDE, SIDE))
            images.append(np.asarray(picture.convert("RGB")))
    return images


@lru_cache
def plates() -> list[np.ndarray]:
    return [
        draw_plate(cvd, 2 * SIDE, np.random.default_rng([seed, 5])).image
        for cvd in ("protan", "deutan")
        for seed in range(6)
    ]


def groups(images: list[np.ndarray], alphas: list[np.ndarray | None] | None = None) -> list[int]:
    return group_by_palette(images, alphas or [None] * len(images))


def cloth(color: tuple[int, int, int], seed: int = 0) -> np.ndarray:
    """A noisy surface of one colour, on grey."""
    image = np.full((SIDE, SIDE, 3), 128.0)
    image[:, SIDE // 3 :] = color
    noise = np.random.default_rng(seed).normal(0.0, 6.0, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("count", [2, 3, 5, 40])
def test_views_of_the_demo_are_one_scene_all_of_them_and_in_runs(count: int) -> None:
    for first in range(0, len(demo()) - count + 1, 5):
        assert set(groups(demo()[first : first + count])) == {0}


def test_plates_are_scenes_of_their_own_among_each_other_and_beside_a_real_scene() -> None:
    assert len(set(groups(plates()))) >= len(plates()) - 1
    found = groups([*plates(), *demo()])
    assert len(set(found[len(plates()) :])) == 1
    assert found[-1] not in found[: len(plates())]


def test_scenes_are_numbered_in_the_order_of_their_first_photographs() -> None:
    red, blue = ([cloth(color, seed) for seed in range(3)] for color in ((200, 40, 40), (40, 60, 200)))
    assert groups([blue[0], red[0], red[1], blue[1], red[2], blue[2]]) == [0, 1, 1, 0, 1, 0]


def test_palettes_that_change_gradually_from_view_to_view_are_one_scene() -> None:
    way = [cloth(tuple(np.array([200, 60, 60]) + step * np.array([-5, 4, 0]))) for step in range(32)]
    assert set(groups(way)) == {0}
    assert groups([way[0], way[-1]]) == [0, 1]


def test_a_view_that_resembles_a_scene_less_joins_it_only_where_that_is_beyond_doubt() -> None:
    near = [cloth((200, 60, 60), seed) for seed in range(6)]
    shade = cloth((186, 71, 62), 9)
    others = [cloth(color) for color in ((40, 60, 200), (60, 160, 60), (220, 200, 60), (30, 30, 60), (200, 60, 200))]
    assert groups([*near, shade])[-1] == 0
    found = groups([near[0], shade, *others])
    assert len(set(found)) == len(found)


def test_what_is_not_covered_has_no_colour() -> None:
    image, other, alpha = cloth((200, 40, 40)), cloth((200, 40, 40), 1), np.zeros((SIDE, SIDE), np.uint8)
    alpha[:, 10:50] = 255
    hidden = other.copy()
    hidden[:, 50:] = (0, 0, 255)
    assert groups([image, hidden], [alpha, alpha]) == [0, 0]
    assert groups([image, hidden]) == [0, 1]


@pytest.mark.parametrize("count", [0, 1])
def test_few_photographs_are_no_problem(count: int) -> None:
    assert groups([cloth((200, 40, 40))] * count) == [0] * count
