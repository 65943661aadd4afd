"""What is matched, what suffices, and what is said of photographs without a place: the parts around pycolmap."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.sfm_images import evened
from cvdgs.core.capture.sfm_job import Placed, SfmJob, SfmSettings
from cvdgs.core.capture.sfm_pairs import pairs_alike, pairs_in_time
from cvdgs.core.capture.sfm_verdict import Frame, read_frames, require_enough, say_left_out
from cvdgs.core.errors import InputError


def names_of(count: int) -> list[str]:
    return [f"{index:02d}.jpg" for index in range(count)]


def test_of_few_photographs_every_pair_is_matched_and_of_many_a_bounded_number_for_each() -> None:
    settings = SfmSettings()
    assert len(pairs_in_time(80, settings)) == settings.pairs(80) == 80 * 79 // 2
    assert len(pairs_in_time(300, settings)) <= settings.pairs(300) < 300 * 26
    assert settings.pairs(2000) < 2000 * 26


def test_neighbours_and_photographs_that_look_alike_are_matched() -> None:
    assert {(0, 1), (0, 10), (0, 16)} <= pairs_in_time(300, SfmSettings())
    generator = np.random.default_rng(0)
    walk = generator.normal(size=(60, 32)).astype(np.float32)
    signatures = np.concatenate([walk, walk + 0.05 * generator.normal(size=walk.shape).astype(np.float32)])
    signatures /= np.linalg.norm(signatures, axis=1, keepdims=True)
    found = pairs_alike(signatures, 3)
    assert {(index, index + 60) for index in range(60)} <= found
    assert all(first < second for first, second in found)
    assert pairs_alike(signatures[:1], 3) == set()


def test_evening_out_makes_dark_and_light_parts_alike() -> None:
    generator = np.random.default_rng(0)
    light = generator.integers(60, 190, (100, 200, 1)).repeat(4, 0).repeat(4, 1).repeat(3, 2)
    light[:, 400:] //= 10
    even = evened(light.astype(np.uint8))
    left, right = even[50:-50, 50:350], even[50:-50, 450:-50]
    assert left.std() == pytest.approx(right.std(), rel=0.35)
    flat = np.full((50, 80, 3), 20, np.uint8)
    assert np.ptp(evened(flat)) <= 2  # nothing is made of nothing


def test_a_model_of_three_of_twenty_is_refused_and_two_of_two_is_not() -> None:
    names = names_of(20)
    with pytest.raises(InputError, match="only 3 of 20 photographs could be connected; 15 show nothing") as refusal:
        require_enough(Placed(names[:3], [3, 2], [1.2], [2] * 5 + [0] * 15), names, Path("room"))
    assert "small steps" in str(refusal.value)
    require_enough(Placed(names[:7], [7]), names, Path("room"))
    require_enough(Placed(names[:2], [2]), names[:2], Path("room"))


def test_turning_on_the_spot_is_told_from_photographs_that_share_nothing() -> None:
    names = names_of(5)
    with pytest.raises(InputError, match="step to the side"):
        require_enough(Placed(matched=[4] * 5), names, Path("room"))
    with pytest.raises(InputError, match="step to the side"):
        require_enough(Placed(matched=[1, 1]), names[:2], Path("room"))
    with pytest.raises(InputError, match="no cameras could be estimated"):
        require_enough(Placed(matched=[0] * 5), names, Path("room"))


def test_passages_of_a_film_without_a_place_are_named_by_their_times() -> None:
    names = names_of(40)
    frames = {name: Frame(index * 0.5, "walk.mp4") for index, name in enumerate(names)}
    placed = Placed([name for index, name in enumerate(names) if not 24 <= index <= 30])
    assert say_left_out(placed, names, frames) == "33 of 40 frames could be connected; film more slowly at 0:12-0:15"
    assert say_left_out(Placed(names), names, frames) == ""
    assert say_left_out(Placed(names[:-8] + names[-7:]), names, frames).endswith("more slowly at 0:16")
    assert "without a place, and left out: 24.jpg" in say_left_out(placed, names, {})


def test_a_list_of_frames_is_found_and_a_damaged_one_refused(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    assert read_frames(folder, tmp_path) == {}
    file = tmp_path / "frames.json"
    file.write_text(json.dumps({"frames": [{"name": "a.jpg", "time": 1.5, "video": "walk.mp4"}]}))
    assert read_frames(folder, tmp_path) == {"a.jpg": Frame(1.5, "walk.mp4")}
    frame = {"name": "a", "time": "x", "video": ""}
    for damaged in ("{", "3", "[]", json.dumps({"frames": [frame]}), '{"frames": [{"name": "a.jpg"}]}', "[" * 9999):
        file.write_text(damaged)
        with pytest.raises(InputError, match=r"no list of a video|not valid JSON"):
            read_frames(folder, tmp_path)


def test_a_list_of_frames_outside_of_the_capture_is_not_read(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    folder.mkdir()
    file = tmp_path / "frames.json"
    file.write_text(json.dumps({"frames": [{"name": "a.jpg", "time": 1.5, "video": "walk.mp4"}]}))
    assert read_frames(folder, folder) == {}
    (folder / "frames.json").symlink_to(file)
    with pytest.raises(InputError, match="leads out of the capture folder"):
        read_frames(folder, folder)


def test_a_draft_looks_at_less_first_and_goes_on_with_the_rest() -> None:
    draft = SfmSettings.for_views(320)
    assert draft.first is not None
    assert draft.first.max_image_size < draft.max_image_size
    assert draft.first.pairs(66) < draft.pairs(66)
    assert replace(draft, first=None) == SfmSettings() == SfmSettings.for_views(640) == SfmSettings.for_views(None)
    job = SfmJob("photographs", ["a.jpg"], [0], "workspace", draft)
    assert SfmJob.from_json(job.to_json()) == job


def test_a_job_travels_as_json() -> None:
    job = SfmJob("photographs", ["a b.jpg"], [0], "workspace", SfmSettings(seed=3))
    assert SfmJob.from_json(job.to_json()) == job
