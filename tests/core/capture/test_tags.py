"""Printed tags in photographs, and the scale that they give, on rendered tags whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from cvdgs.core.capture.model import Capture, PinholeCamera, View
from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.tag_scale import metres_per_unit
from cvdgs.core.capture.tags import CODES, FRAMED, find_tags, pattern, square_to
from cvdgs.core.errors import InputError

CAMERA = PinholeCamera(640, 480, 600.0, 600.0, 320.0, 240.0)
SIDE = 0.4  # units of the world, of a tag on the plane z = 0


def look_from(place: tuple[float, float, float], target: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    forward = np.subtract(target, place) / np.linalg.norm(np.subtract(target, place))
    right = np.cross(forward, (0.0, -1.0, 0.1))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ place
    return pose


def corners_of(pose: np.ndarray, center=(0.0, 0.0), side: float = SIDE, turn: float = 0.0) -> np.ndarray:
    """(4, 2) in pixels of a tag's corners; the tag lies on z = 0 and is seen from z > 0 or below alike."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * side / 2.0
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    world = np.column_stack([square @ spin.T + center, np.zeros(4)])
    shown = world @ pose[:3, :3].T + pose[:3, 3]
    return shown[:, :2] / shown[:, 2:] * (CAMERA.fx, CAMERA.fy) + (CAMERA.cx, CAMERA.cy)


def draw(tags: dict[int, np.ndarray], noise: float = 3.0, blur: float = 0.8) -> np.ndarray:
    """A photograph of tags with these corners on white paper, before a grey wall."""
    oversampled = 4
    generator = np.random.default_rng(0)
    picture = np.full((CAMERA.height * oversampled, CAMERA.width * oversampled), 120.0)
    for number, corners in tags.items():
        cells, inverse = np.pad(pattern(number), 2, constant_values=True), np.linalg.inv(square_to(corners))
        reach = 0.5 * np.ptp(corners, axis=0)
        low, high = (
            np.clip(bound * oversampled, 0, picture.shape[::-1]).astype(int)
            for bound in (corners.min(axis=0) - reach, corners.max(axis=0) + reach)
        )
        window = picture[low[1] : high[1], low[0] : high[0]]
        y, x = (np.mgrid[low[1] : high[1], low[0] : high[0]] + 0.5) / oversampled
        u, v, w = (inverse[row, 0] * x + inverse[row, 1] * y + inverse[row, 2] for row in range(3))
        column, row = np.floor(u / w * FRAMED).astype(int), np.floor(v / w * FRAMED).astype(int)
        inside = (np.minimum(column, row) >= -2) & (np.maximum(column, row) < FRAMED + 2)
        window[inside] = np.where(cells[row[inside] + 2, column[inside] + 2], 215.0, 35.0)
    small = picture.reshape(CAMERA.height, oversampled, CAMERA.width, oversampled).mean(axis=(1, 3))
    noisy = ndimage.gaussian_filter(small, blur) + generator.normal(0.0, noise, small.shape)
    return np.repeat(np.clip(noisy, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def photograph(pose: np.ndarray, tags: dict[int, np.ndarray]) -> View:
    return View("a", Path("a.jpg"), CAMERA, pose, draw(tags))


PLACES = [(0.0, 0.3, -1.6), (0.8, 0.5, -1.5), (-0.9, 0.2, -1.4), (0.4, -0.8, -1.7)]


def test_two_numbers_differ_in_eleven_cells_however_they_are_turned() -> None:
    turned = [
        [np.rot90(pattern(number), quarters)[1:-1, 1:-1].ravel() for quarters in range(4)] for number in range(30)
    ]
    assert len(CODES) == 30
    for first in range(30):
        for second in range(first):
            assert min(np.count_nonzero(turned[first][0] != other) for other in turned[second]) >= 11


# The cells of three numbers as OpenCV draws them (cv2.aruco, DICT_APRILTAG_36h11); # is black.
DRAWN_BY_OPENCV = {
    0: ("##.###", "#..#.#", "###.#.", "###..#", ".#...#", ".#.#.."),
    7: ("##.#.#", "...###", "#...#.", "##.#.#", "#..###", "##.###"),
    29: ("#.###.", ".#.##.", ".####.", ".....#", "#####.", ".#.#.."),
}


@pytest.mark.parametrize("number", DRAWN_BY_OPENCV)
def test_a_tag_that_another_program_has_printed_is_read(number: int) -> None:
    cells = np.array([[cell == "." for cell in row] for row in DRAWN_BY_OPENCV[number]])
    sheet = np.pad(np.pad(cells, 1), 4, constant_values=True)
    picture = np.where(np.kron(sheet, np.ones((12, 12), bool)), 220, 30).astype(np.uint8)
    (tag,) = find_tags(np.repeat(picture[..., None], 3, axis=2))
    assert tag.number == number


@pytest.mark.parametrize("turn", [0.0, 1.2, 2.9, 4.0])
@pytest.mark.parametrize("place", PLACES)
def test_a_tag_is_found_turned_and_from_the_side_with_corners_to_a_fifth_of_a_pixel(place, turn) -> None:
    truth = corners_of(look_from(place), turn=turn)
    (tag,) = find_tags(draw({7: truth}))
    assert tag.number == 7
    assert np.abs(tag.corners - truth).max() < 0.2


def test_a_small_dark_blurred_tag_is_found_and_noise_and_squares_are_none() -> None:
    truth = corners_of(look_from((0.5, 0.2, -4.2)))
    (tag,) = find_tags(draw({3: truth}, noise=5.0, blur=1.0) // np.uint8(2))
    assert tag.number == 3
    generator = np.random.default_rng(1)
    assert find_tags(generator.integers(0, 256, (240, 320, 3)).astype(np.uint8)) == []
    squares = np.full((240, 320, 3), 220, np.uint8)
    squares[60:140, 50:130] = 20
    squares[80:100, 200:260] = 20
    assert find_tags(squares) == []


@pytest.mark.parametrize("metres", [0.1, 0.16])
def test_a_tag_of_known_side_gives_metres(metres: float) -> None:
    poses = [look_from(place) for place in PLACES]
    views = [photograph(pose, {0: corners_of(pose)}) for pose in poses]
    assert metres_per_unit(views, metres, Path("room")) == pytest.approx(metres / SIDE, rel=3e-3)


def test_a_capture_is_looked_at_in_full_size_however_small_its_views_are(tmp_path: Path) -> None:
    poses = [look_from(place) for place in PLACES]
    views = [replace(photograph(pose, {0: corners_of(pose)}), key=str(number)) for number, pose in enumerate(poses)]
    nothing = np.zeros((0, 3), np.float32)
    write_capture(Capture(tmp_path, "rendered", tuple(views), nothing, nothing.astype(np.uint8)), tmp_path)
    capture = read_capture(tmp_path, max_size=64, tag_side=0.1)
    assert capture.views[0].camera.width == 64
    assert capture.metres_per_unit == pytest.approx(0.1 / SIDE, rel=3e-3)
    assert read_capture(tmp_path, max_size=64).metres_per_unit is None


def test_one_photograph_that_sees_it_elsewhere_is_left_out_and_several_are_refused() -> None:
    poses = [look_from(place) for place in PLACES]
    views = [photograph(pose, {0: corners_of(pose)}) for pose in poses]
    views[1] = photograph(poses[1], {0: corners_of(poses[1], center=(0.2, 0.1))})
    assert metres_per_unit(views, 0.1, Path("room")) == pytest.approx(0.1 / SIDE, rel=5e-3)
    views[2] = photograph(poses[2], {0: corners_of(poses[2], center=(-0.2, 0.1))})
    with pytest.raises(InputError, match=r"4 photographs show tag 0, and only . agree on where it is"):
        metres_per_unit(views, 0.1, Path("room"))


def test_photographs_none_of_which_agree_are_refused() -> None:
    first, second = (look_from(place) for place in PLACES[:2])
    behind = np.eye(4)  # the world's origin lies behind the cameras, where each photograph alone puts its tag
    behind[:3, 3] = 2.0 * np.mean(PLACES, axis=0)
    views = [
        photograph(first @ behind, {0: corners_of(first)}),
        photograph(second @ behind, {0: corners_of(second, center=(-0.2, 0.1))}),
    ]
    with pytest.raises(InputError, match=r"2 photographs show tag 0, and only 1 agree on where it is"):
        metres_per_unit(views, 0.1, Path("room"))


def test_tags_of_two_sizes_are_refused() -> None:
    poses = [look_from(place) for place in PLACES]
    views = [
        photograph(pose, {0: corners_of(pose, (-0.25, 0.0), 0.3), 1: corners_of(pose, (0.25, 0.0), 0.25)})
        for pose in poses
    ]
    with pytest.raises(InputError, match=r"the tags disagree \(0: .* m a unit, 1: "):
        metres_per_unit(views, 0.1, Path("room"))


def test_no_tag_and_one_place_are_refused_with_what_to_do() -> None:
    pose = look_from(PLACES[0])
    empty = photograph(pose, {})
    with pytest.raises(InputError, match=r"none of 2 photographs shows a tag .* scripts/scale_sheet\.py"):
        metres_per_unit([empty, empty], 0.1, Path("room"))
    seen = photograph(pose, {0: corners_of(pose)})
    for views in ([seen, empty], [seen, replace(seen, key="b")]):
        with pytest.raises(InputError, match="tag 0 is not shown by two photographs from different places"):
            metres_per_unit(views, 0.1, Path("room"))
