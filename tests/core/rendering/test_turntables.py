"""Turntables of a run, with a program in Blender's place that writes the pictures it is asked for."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest

from cvdgs.core.rendering.turntables import render_turntables
from cvdgs.core.runtime.process import Workers
from cvdgs.core.runtime.supervisor import Log
from cvdgs.core.settings import Settings

BLENDER = f"""\
#!{sys.executable}
import json, sys
from pathlib import Path
request = json.loads(sys.stdin.readline())
with open(Path(__file__).with_name("requests"), "a") as requests:
    requests.write(json.dumps(request) + "\\n")
arguments = request["arguments"]
folder = Path(request["out"], arguments["folder"])
folder.mkdir(parents=True)
for number in range(arguments["first"], arguments["last"] + 1):
    (folder / f"{{number:04d}}.png").write_text(arguments["layer"])
    print(json.dumps({{"event": "progress", "stage": "frames", "message": "picture", "seconds_left": 9.0,
                      "fraction": number / arguments["frames"]}}), flush=True)
result = {{"pictures": 2, "seconds": {{"loading": 0.5, "pictures": [1.0, 1.5]}}}}
print(json.dumps({{"event": "result", **result}}), flush=True)
"""


@pytest.fixture
def blender(as_blender) -> Path:
    """Folder of the program; what it was asked for stands in ``requests``."""
    return as_blender(BLENDER)


def turn(folder: Path, pictures: int, *layers: str, engine: str = "cycles", before: dict | None = None):
    """What the report says after what it said `before`, and the events."""
    report = {"capture": {"width": 64, "height": 48}, "layers": dict.fromkeys(layers), "turntable": before}
    events: list[dict] = []
    settings = Settings("photos", str(folder), turntable=pictures, simulation="vienot", engine=engine)
    return render_turntables(folder, report, settings, Workers(), Log(io.StringIO(), events.append)), events


def asked_for(blender: Path) -> list[str]:
    requests = [json.loads(line)["arguments"] for line in (blender / "requests").read_text().splitlines()]
    return [arguments["layer"] for arguments in requests if "layer" in arguments]  # others ask about EEVEE


def test_a_turn_is_not_rendered_through_a_link_in_a_run_from_elsewhere(blender, tmp_path):
    (tmp_path / "photographs").mkdir()
    (tmp_path / "photographs" / "0001.png").write_text("mine")
    (tmp_path / "out" / "turntable").mkdir(parents=True)
    (tmp_path / "out" / "turntable" / "original").symlink_to(tmp_path / "photographs")
    turn(tmp_path / "out", 3)
    assert (tmp_path / "photographs" / "0001.png").read_text() == "mine"
    assert len(list((tmp_path / "out" / "turntable" / "original").iterdir())) == 3


def test_every_layer_is_rendered_all_around_in_the_size_of_the_photographs(blender, tmp_path):
    said, _ = turn(tmp_path / "out", 3, "deutan-1.0")
    assert said == {
        "frames": 3,
        "layers": ["original", "deutan-1.0"],
        "engine": "cycles",
        "orbit": {"radius": 0.0, "height": None, "focal_length": 0.0, "arc": 0.0},
    }
    for layer in said["layers"]:
        folder = tmp_path / "out" / "turntable" / layer
        assert sorted(path.name for path in folder.iterdir()) == ["0001.png", "0002.png", "0003.png"]
        assert (folder / "0002.png").read_text() == layer
    request = json.loads((blender / "requests").read_text().splitlines()[0])
    assert (request["arguments"]["width"], request["arguments"]["height_pixels"]) == (64, 48)
    assert not request["arguments"]["simulated"]


def test_a_further_layer_leaves_the_pictures_that_are_there(blender, tmp_path):
    said, _ = turn(tmp_path, 3, "deutan-1.0")
    turn(tmp_path, 3, "deutan-1.0", "protan-1.0", before=said)
    assert asked_for(blender) == ["original", "deutan-1.0", "protan-1.0"]


def test_pictures_of_two_engines_do_not_go_together(blender, tmp_path):
    said, _ = turn(tmp_path, 3, engine="eevee")
    said, _ = turn(tmp_path, 3, "protan-1.0", before=said)
    assert asked_for(blender) == ["original", "original", "protan-1.0"]
    assert said["engine"] == "cycles"


def test_pictures_of_an_earlier_version_from_another_height_do_not_go_with_those_of_a_further_layer(blender, tmp_path):
    said, _ = turn(tmp_path, 3, "deutan-1.0")
    for earlier in ({**said, "orbit": {**said["orbit"], "height": 0.25}}, {**said, "orbit": None}):
        (blender / "requests").unlink()
        turn(tmp_path, 3, "deutan-1.0", "protan-1.0", before=earlier)
        assert asked_for(blender) == ["original", "deutan-1.0", "protan-1.0"]


def test_another_number_of_pictures_is_another_turn(blender, tmp_path):
    turn(tmp_path, 5)
    turn(tmp_path, 3)
    assert asked_for(blender) == ["original", "original"]
    assert len(list((tmp_path / "turntable" / "original").iterdir())) == 3


def test_the_progress_of_all_layers_is_that_of_one_stage(blender, tmp_path):
    _, events = turn(tmp_path, 4, "deutan-1.0")
    assert {event["stage"] for event in events} == {"turntable"}
    fractions = [event["fraction"] for event in events if event["event"] == "progress"]
    assert fractions == sorted(fractions)
    assert len(fractions) == 8
    assert fractions[-1] == 1.0
    assert events[-1]["message"].startswith("deutan-1.0: ")
