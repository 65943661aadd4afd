"""Requests for pictures, with a program in Blender's place that does as it is told or ends as Blender may."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.rendering.frames import render as render_pictures
from cvdgs.core.rendering.requests import FramesArguments
from cvdgs.core.runtime.supervisor import WorkerDefect

BLENDER = f"""\
#!{sys.executable}
import json, os, sys
from pathlib import Path
request = json.loads(sys.stdin.readline())
folder = Path(__file__).parent
with open(folder / "requests", "a") as requests:
    requests.write(json.dumps(request) + "\\n")
ending = folder / request["job"]
if ending.exists():
    exec(ending.read_text())
result = {{"pictures": 2, "seconds": {{"loading": 0.5, "pictures": [1.0, 1.5]}}}}
print(json.dumps({{"event": "result", **result}}), flush=True)
"""
ABORT = "os.abort()"  # what Blender does where there is no OpenGL
REFUSE = "print(json.dumps({'event': 'error', 'kind': 'input', 'message': 'no run'}), flush=True); sys.exit(2)"


@pytest.fixture
def blender(as_blender) -> Path:
    """Folder of the program: how a job ends stands in a file of the job's name, and what was asked in ``requests``."""
    return as_blender(BLENDER)


def render(out: Path, engine: str) -> list[dict]:
    """The events of two pictures on three cores."""
    arguments = FramesArguments(
        run="run",
        layer="original",
        engine=engine,
        folder="frames",
        first=1,
        last=2,
        frames=8,
        width=64,
        height_pixels=48,
        simulated={"deutan-1.0": "simulated"},
        model="brettel",
    )
    events: list[dict] = []
    render_pictures(arguments, out, events.append, threads=3)
    return events


def requests(blender: Path) -> list[dict]:
    return [json.loads(line) for line in (blender / "requests").read_text().splitlines()]


def test_blender_is_asked_for_what_the_request_says(blender, tmp_path):
    events = render(tmp_path, "cycles")
    (request,) = requests(blender)
    assert (request["job"], request["out"], request["threads"]) == ("frames", str(tmp_path), 3)
    assert request["arguments"]["model"] == "brettel"
    assert (request["arguments"]["first"], request["arguments"]["last"]) == (1, 2)
    assert events[-1]["message"] == "2 pictures in 2.5 s, loaded in 0.5 s"


def test_where_eevee_works_it_is_used(blender, tmp_path):
    events = render(tmp_path, "eevee")
    assert [request["job"] for request in requests(blender)] == ["try-eevee", "frames"]
    assert requests(blender)[-1]["arguments"]["engine"] == "eevee"
    assert "warning" not in {event["event"] for event in events}


def test_without_opengl_cycles_takes_eevees_place_and_says_so(blender, tmp_path):
    (blender / "try-eevee").write_text(ABORT)
    events = render(tmp_path, "eevee")
    assert requests(blender)[-1]["arguments"]["engine"] == "cycles"
    (warning,) = [event for event in events if event["event"] == "warning"]
    assert warning["name"] == "no-eevee"
    assert "Cycles" in warning["message"]


def test_a_refusal_and_a_crash_are_told_apart(blender, tmp_path):
    (blender / "frames").write_text(REFUSE)
    with pytest.raises(InputError, match=r"^no run$"):
        render(tmp_path, "cycles")
    (blender / "frames").write_text(ABORT)
    with pytest.raises(WorkerDefect, match="ended by signal 6"):
        render(tmp_path, "cycles")
