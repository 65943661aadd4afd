"""Captures are named on the command line, and texts show the command without the places of this machine."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from cvdgs.core.demo import SHOWROOM
from cvdgs.core.errors import InputError
from cvdgs.core.evaluate.studies.scenes import DEMO, SHOWROOMS, capture_sources, showrooms
from cvdgs.core.events import Reporter
from cvdgs.scripts.benchmarks.study_options import QUICK, add_study_arguments, settled, shown_command, work_folder


def sources(tmp_path: Path, *asked: str):
    return capture_sources(asked, 96, tmp_path / "scenes", Reporter())


def rendered(folder: Path, name: str) -> Path:
    """A showroom that an earlier call has rendered."""
    (folder / name).mkdir(parents=True)
    (folder / name / "transforms.json").write_text("{}")
    return folder / name


def test_the_demo_is_the_shipped_one(tmp_path):
    (source,) = sources(tmp_path, DEMO)
    assert (source.name, source.folder, source.max_size) == ("demo", SHOWROOM, 96)


def test_a_showroom_that_is_there_is_not_rendered_again(tmp_path):
    places = {name: rendered(tmp_path, name) for name in SHOWROOMS if name != DEMO}
    assert showrooms(tmp_path, Reporter()) == {DEMO: SHOWROOM, **places}


def test_folders_are_taken_by_their_names_or_by_given_ones(tmp_path):
    place = tmp_path / "room"
    place.mkdir()
    found = sources(tmp_path, str(place), f"other={place}")
    assert [(source.name, source.folder) for source in found] == [("room", place), ("other", place)]


def test_a_folder_can_stand_in_for_a_showroom(tmp_path):
    (source,) = sources(tmp_path, f"{SHOWROOMS[1]}={tmp_path}")
    assert (source.name, source.folder) == (SHOWROOMS[1], tmp_path)


def test_a_capture_that_is_not_there_is_refused_with_those_that_are(tmp_path):
    with pytest.raises(InputError, match=r"no capture 'nowhere'.*demo, showroom-protan, showroom-tritan"):
        sources(tmp_path, "nowhere")


def test_two_captures_of_one_name_are_refused(tmp_path):
    with pytest.raises(InputError, match="two captures have one name"):
        sources(tmp_path, f"demo={tmp_path}", "demo")


def options(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path)
    add_study_arguments(parser, max_size=240, iterations=800, seeds=3)
    return parser.parse_args(arguments)


def test_quick_changes_what_was_left_at_its_default_and_nothing_else():
    quick = settled(options("--quick", "--iterations", "70"))
    assert quick.iterations == 70
    assert (quick.captures, quick.max_size, quick.seeds) == (QUICK["captures"], QUICK["max_size"], QUICK["seeds"])
    usual = settled(options())
    assert (usual.captures, usual.max_size, usual.iterations, usual.seeds) == (SHOWROOMS, 240, 800, 3)


def test_what_is_no_result_goes_beside_the_results_or_elsewhere():
    assert work_folder(options("--out", "tables")) == Path("tables/work")
    assert work_folder(options("--out", "tables", "--work", "scratch")) == Path("scratch")


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        ("table --out /home/me/out --seeds 2", "table --out DIR --seeds 2"),
        ("table --out=/home/me/out --work=/tmp/w", "table --out DIR --work DIR"),
        ("table --captures demo,room=/home/me/room,/data/fox", "table --captures demo,room=PATH,PATH/fox"),
        ("table --captures=room=/home/me/room", "table --captures room=PATH"),
        ("ablation --weights instance=/home/me/w.safetensors", "ablation --weights instance=PATH"),
    ],
)
def test_texts_show_no_place_of_this_machine(arguments, shown):
    found = shown_command(argparse.Namespace(part="table"), arguments.split())
    assert found == f"python scripts/benchmark.py {shown}"
