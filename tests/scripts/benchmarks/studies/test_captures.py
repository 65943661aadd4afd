"""Captures are named on the command line, and loaded as recipes are given and judged by them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmarks.studies import captures
from cvdgs.scripts.benchmarks.studies.captures import (
    DEMO,
    SHOWROOMS,
    CaptureFolder,
    Centred,
    capture_sources,
    render_showrooms,
    showrooms,
)


def test_recipes_can_be_given_smaller_photographs_than_they_are_judged_by():
    subject = CaptureFolder("demo", SHOWROOM, 64, fitted_size=48).load()
    assert {view.camera.width for view in subject.given.views} == {48}
    assert {view.camera.width for view in subject.judged.views} == {64}
    assert [view.key for view in subject.given.views] == [view.key for view in subject.judged.views]
    assert subject.split == subject.judged_split
    assert not subject.is_ordinary


@pytest.mark.parametrize("fitted_size", [None, 64, 100])
def test_photographs_are_not_enlarged(fitted_size):
    assert CaptureFolder("demo", SHOWROOM, 64, fitted_size).load().is_ordinary


@pytest.mark.parametrize(("cx", "cy"), [(24.0, 18.0), (26.2, 16.9), (20.45, 18.0), (24.1, 21.5)])
def test_a_capture_can_be_cropped_until_its_principal_points_are_in_the_middle(tmp_path, cx, cy):
    whole = CaptureFolder("demo", SHOWROOM, 48).load().given
    views = tuple(replace(view, camera=replace(view.camera, cx=cx, cy=cy)) for view in whole.views)
    write_capture(replace(whole, views=views), tmp_path / "off")
    base = CaptureFolder("off", tmp_path / "off", 48)
    view, given = Centred(base).load().given.views[3], base.load().given.views[3]
    camera = view.camera
    assert view.image.shape == (camera.height, camera.width, 3)
    assert abs(camera.cx - camera.width / 2) <= 0.25
    assert abs(camera.cy - camera.height / 2) <= 0.25
    left, top = round(given.camera.cx - camera.cx), round(given.camera.cy - camera.cy)
    assert np.array_equal(view.image, given.image[top : top + camera.height, left : left + camera.width])
    assert camera.width >= 48 - 2 * abs(cx - 24.0) - 2  # no more than needed
    assert Centred(base).key != base.key


def test_a_subject_s_key_tells_sizes_apart():
    keys = {CaptureFolder("demo", SHOWROOM, 64, size).key for size in (None, 32, 48)}
    assert len(keys) == 3


def test_a_subject_s_key_changes_with_a_digit_of_a_file(tmp_path):
    file, source = tmp_path / "transforms.json", CaptureFolder("any", tmp_path, 64)
    file.write_text('{"fl_x": 500}')
    first = source.key
    assert source.key == first
    file.write_text('{"fl_x": 501}')
    assert source.key != first


def sources(tmp_path: Path, *asked: str):
    return capture_sources(asked, 96, tmp_path / "scenes", Reporter())


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of what is rendered, which takes no time."""
    made: list[str] = []

    def render(folder: Path, arguments: Sequence[str], reporter: Reporter) -> None:
        folder.mkdir(parents=True)
        (folder / "transforms.json").write_text(" ".join(arguments))
        made.append(folder.name)

    monkeypatch.setattr(captures, "_render", render)
    return made


def test_the_demo_is_the_shipped_one(tmp_path):
    (source,) = sources(tmp_path, DEMO)
    assert (source.name, source.folder, source.max_size) == ("demo", SHOWROOM, 96)


def test_a_showroom_that_is_there_is_not_rendered_again(tmp_path, rendered):
    found = showrooms(tmp_path, Reporter())
    assert list(found) == list(SHOWROOMS)
    assert found[DEMO] == SHOWROOM
    assert len(rendered) == len(SHOWROOMS) - 1
    assert showrooms(tmp_path, Reporter()) == found
    assert len(rendered) == len(SHOWROOMS) - 1


def test_a_showroom_that_is_to_be_another_is_rendered_beside_it(tmp_path, rendered):
    first, other = (render_showrooms({"room": ("--seed", seed)}, tmp_path, Reporter())["room"] for seed in "12")
    assert len(rendered) == 2
    assert (first / "transforms.json").read_text() == "--seed 1"
    assert (other / "transforms.json").read_text() == "--seed 2"


def test_folders_are_taken_by_their_names_or_by_given_ones(tmp_path):
    place = tmp_path / "room"
    place.mkdir()
    found = sources(tmp_path, str(place), f"other={place}")
    assert [(source.name, source.folder) for source in found] == [("room", place), ("other", place)]


def test_a_folder_can_stand_in_for_a_showroom(tmp_path):
    (source,) = sources(tmp_path, f"{SHOWROOMS[1]}={tmp_path}")
    assert (source.name, source.folder) == (SHOWROOMS[1], tmp_path)


def test_a_capture_that_is_not_there_is_refused_with_those_that_are(tmp_path):
    with pytest.raises(InputError, match=r"unknown capture 'nowhere'.*demo, showroom-protan, showroom-tritan"):
        sources(tmp_path, "nowhere")


def test_two_captures_of_one_name_are_refused(tmp_path):
    with pytest.raises(InputError, match="two captures have the same name"):
        sources(tmp_path, f"demo={tmp_path}", "demo")
