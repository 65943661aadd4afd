"""Frames are chosen by motion and sharpness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from cvdgs.core.intake.motion import Follower, motion_between
from cvdgs.core.intake.selection import choose
from cvdgs.core.intake.video import extract, look_through

from .films import HEIGHT, RATE, WIDTH, wall, window, write_video

WALL = wall()


def chosen_numbers(path: Path) -> list[int]:
    (frames,) = choose([look_through(path).film])
    return [frame.number for frame in frames]


def test_points_are_followed_to_a_tenth_of_a_pixel() -> None:
    grey = WALL.mean(2)
    follower = Follower()
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)

    def seen(shift: float) -> np.ndarray:
        return map_coordinates(grey, [y + 200, x + 200 + shift], order=3).clip(0, 255).astype(np.uint8)

    first = follower.advance(seen(0.0))
    second = follower.advance(seen(7.3))
    common = np.isin(second.numbers, first.numbers)
    moved = second.places[common] - first.places[np.isin(first.numbers, second.numbers)]
    assert common.sum() > 60
    assert np.abs(np.median(moved, axis=0) - [-7.3, 0.0]).max() < 0.1
    assert motion_between(first, second).shift == pytest.approx(7.3 / WIDTH, abs=0.002)


def turned(degrees: float, focal: float = 0.85 * WIDTH) -> np.ndarray:
    """The wall as a camera sees it that only turns."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    rays = np.stack([(x - WIDTH / 2) / focal, (y - HEIGHT / 2) / focal, np.ones_like(x)], -1)
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    rays = rays @ turn.T
    places = rays[..., :2] / rays[..., 2:] * focal
    return map_coordinates(WALL.mean(2), [places[..., 1] + 450, places[..., 0] + 450], order=1).astype(np.uint8)


def test_a_turn_of_the_camera_has_no_parallax_and_steps_sideways_past_two_depths_have() -> None:
    follower = Follower()
    followed = [follower.advance(turned(degrees)) for degrees in (0.0, 2.0, 4.0, 6.0)]
    pan = motion_between(followed[0], followed[-1])
    assert pan.shift > 0.05
    assert pan.parallax < 0.003

    near, far = WALL[:, :, 0], wall(1)[:, :, 0]
    follower, followed = Follower(), []
    for step in range(4):
        both = far[100 : 100 + HEIGHT, 100 + 2 * step : 100 + 2 * step + WIDTH].copy()
        both[HEIGHT // 2 :] = near[100 : 100 + HEIGHT // 2, 100 + 8 * step : 100 + 8 * step + WIDTH]
        followed.append(follower.advance(both))
    assert motion_between(followed[0], followed[-1]).parallax > 0.01


def test_standing_still_gives_one_frame_and_walking_many(tmp_path: Path) -> None:
    still = [window(WALL, 50)] * RATE * 2
    walk = [window(WALL, 50 + 6 * step) for step in range(RATE * 3)]
    numbers = chosen_numbers(write_video(tmp_path / "x.mp4", still + walk))
    assert sum(number < len(still) for number in numbers) <= 1
    assert 4 <= len(numbers) <= 20


def test_a_fast_turn_has_more_frames_a_second_than_a_slow_one(tmp_path: Path) -> None:
    slow = [window(WALL, 20 + 2 * step) for step in range(RATE * 4)]
    fast = [window(WALL, 140 + 14 * step) for step in range(RATE * 2)]
    numbers = chosen_numbers(write_video(tmp_path / "x.mp4", slow + fast))
    slow_rate = sum(number < len(slow) for number in numbers) / 4
    fast_rate = sum(number >= len(slow) for number in numbers) / 2
    assert fast_rate > 1.5 * slow_rate


def test_neighbours_share_most_of_what_they_show(tmp_path: Path) -> None:
    """Whatever the speed, at most a fifth of the picture has passed between two of them."""
    speeds = [2, 6, 10, 14]
    places = np.cumsum([0, *(speed for speed in speeds for _ in range(RATE))]) + 50
    numbers = chosen_numbers(write_video(tmp_path / "x.mp4", [window(WALL, x) for x in places]))
    steps = np.diff(places[numbers]) / WIDTH
    assert steps.max() <= 0.2
    assert np.median(steps) <= 0.15


def walk_past_two_depths(path: Path) -> Path:
    """The lower half is near: what the two halves differ by, no turn explains."""
    near, frames = wall(1), []
    for step in range(RATE * 4):
        picture = window(WALL, 60 + 0.5 * step)
        picture[HEIGHT // 2 :] = window(near, 60 + 2 * step)[: HEIGHT - HEIGHT // 2]
        frames.append(picture)
    return write_video(path, frames)


def test_a_draft_takes_fewer_frames_of_a_walk_and_knows_as_well_where_it_turns(tmp_path: Path) -> None:
    film = look_through(walk_past_two_depths(tmp_path / "x.mp4")).film
    draft, standard, as_filmed = (len(choose([film], size=size)[0]) for size in (320, 640, None))
    assert draft <= standard == as_filmed
    turn = look_through(write_video(tmp_path / "y.mp4", [window(WALL, 20 + 10 * n) for n in range(RATE * 4)])).film
    assert choose([turn], size=320) == choose([turn], size=640)


def test_of_frames_that_see_the_same_the_sharpest_is_taken(tmp_path: Path) -> None:
    walk = [window(WALL, 50 + 4 * step) for step in range(RATE * 4)]
    sharp = {number for number in range(len(walk)) if number % 3 == 1}
    blurred = [frame if number in sharp else gaussian_filter(frame, (0, 2, 0)) for number, frame in enumerate(walk)]
    numbers = chosen_numbers(write_video(tmp_path / "x.mp4", blurred))
    assert len(numbers) >= 4
    assert len(sharp.intersection(numbers)) >= 0.8 * len(numbers)  # a third of all frames are sharp


def test_the_frames_of_all_videos_together_stay_below_the_limit(tmp_path: Path) -> None:
    films = []
    for number in range(2):
        walk = [window(WALL, 20 + 8 * step) for step in range(RATE * 4)]
        films.append(look_through(write_video(tmp_path / f"{number}.mp4", walk)).film)
    assert sum(map(len, choose(films, most=10))) <= 10
    assert all(len(frames) >= 2 for frames in choose(films, most=10))


def test_the_frames_that_were_chosen_are_those_that_are_written(tmp_path: Path) -> None:
    """Each frame says its number by its grey value; some are far apart, so that the file is searched."""
    frames = [np.full((HEIGHT, WIDTH, 3), 20 + number, np.uint8) for number in range(RATE * 12)]
    look = look_through(write_video(tmp_path / "x.mp4", frames))
    chosen = [look.film.frames[number] for number in (0, 7, 100, 101, 170)]
    written = extract(look, chosen, tmp_path / "out", look.white)
    from PIL import Image

    values = [np.asarray(Image.open(tmp_path / "out" / name)).mean() for name, _ in written]
    assert [round(value - 20) for value in values] == [0, 7, 100, 101, 170]
    assert [round(time * RATE) for _, time in written] == [0, 7, 100, 101, 170]
