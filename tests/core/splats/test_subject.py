"""Where photographs go around one thing, a crop to it is proposed, and convert.py does it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import PinholeCamera, View
from cvdgs.core.errors import InputError
from cvdgs.core.pipeline.cleaning import propose_crop
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.io.ply import read_ply, write_ply
from cvdgs.core.splats.subject import Subject, find_subject
from cvdgs.scripts import convert

CAMERA = PinholeCamera(80, 60, 80.0, 80.0, 40.0, 30.0)
THING = np.array([1.0, -2.0, 5.0])


def looking(place: np.ndarray, target: np.ndarray) -> View:
    forward = (target - place) / np.linalg.norm(target - place)
    right = np.cross(forward, [0.0, 0.3, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ place
    return View("0", Path("0.png"), CAMERA, pose, np.zeros((60, 80, 3), np.uint8))


def scene() -> Gaussians:
    """A third of it a ball around the thing, the rest far around."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(900, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distances = np.where(np.arange(900) < 300, rng.uniform(0, 0.8, 900), rng.uniform(6, 9, 900))
    means = (THING + directions * distances[:, None]).astype(np.float32)
    return Gaussians(means, np.zeros((900, 3), np.float32), np.eye(4, dtype=np.float32)[np.zeros(900, int)],
                     np.zeros(900, np.float32), np.zeros((900, 1, 3), np.float32))  # fmt: skip


def around(jitter: float = 0.2) -> list[View]:
    rng = np.random.default_rng(1)
    angles = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    places = THING + np.column_stack([4 * np.cos(angles), 4 * np.sin(angles), 1 + 0 * angles])
    return [looking(place, THING + rng.normal(0, jitter, 3)) for place in places]


def test_what_cameras_go_around_is_found_and_half_a_scene_is_not() -> None:
    found = find_subject(around(), scene())
    assert found is not None
    assert np.linalg.norm(found.center - THING) < 0.2
    assert found.radius > 0.8
    half = np.arctan(0.5 * CAMERA.height / CAMERA.fy)  # of the field of view, from top to bottom
    assert all(found.radius < np.linalg.norm(view.center - found.center) * np.sin(half) for view in around())
    assert found.holds(scene()).sum() == 300


def test_the_subject_ends_before_a_camera_that_came_close() -> None:
    near = looking(THING + np.array([1.1, 0.0, 0.0]), THING)
    found = find_subject([*around(), near], scene())
    assert found is not None
    assert found.radius < np.linalg.norm(near.center - found.center)


def test_a_room_that_one_looks_around_in_has_no_subject() -> None:
    rng = np.random.default_rng(0)
    places = rng.normal(0, 0.5, (20, 3))
    outwards = [looking(place, place + rng.normal(size=3) * (1, 1, 0.2)) for place in places]
    assert find_subject(outwards, scene()) is None
    along = [looking(np.array([x, 0.0, 0.0]), np.array([x, 9.0, 0.0])) for x in range(10)]
    assert find_subject(along, scene()) is None


def test_the_report_says_what_a_crop_would_keep_and_convert_does_it(tmp_path: Path) -> None:
    figures: dict = {"notes": {}}
    proposed = propose_crop(around(), scene(), figures)
    assert proposed["gaussians"] == 300
    note = figures["notes"]["subject"]
    assert "300 of 900 Gaussians (33%)" in note
    write_ply(tmp_path / "splats.ply", scene())
    crop = note.partition('--crop "')[2].rstrip('"')
    paths = [str(tmp_path / name) for name in ("splats.ply", "subject.ply")]
    assert convert.main([*paths, "--crop", crop]) == 0
    assert len(read_ply(tmp_path / "subject.ply")) == 300
    assert propose_crop([], scene(), figures) == {}
    for unusable in ("0,0 1", "0,0,0", "0,0,0 0", "nan,0,0 1", "0,0,0 inf", "90,90,90 1"):
        assert convert.main([paths[0], str(tmp_path / "none.ply"), "--crop", unusable]) == 2
    assert not (tmp_path / "none.ply").exists()
    with pytest.raises(InputError, match="no sphere"):
        Subject.parse("x")
