"""What a run tells the console."""

import io
import os
import subprocess
import sys

import pytest

from cvdgs.core.runtime.progress import RunProgress
from cvdgs.core.runtime.supervisor import BarDisplay

from ...patience import SOON


def shown(*events: dict) -> list[str]:
    """The lines that a log gets, one for each stage."""
    stream = io.StringIO()
    display = BarDisplay(
        stream, "run.py", RunProgress(("capture", "geometry")), lambda result: f"done: {result['out']}"
    )
    for event in events:
        display(event)
    return stream.getvalue().splitlines()


def test_the_bar_goes_by_what_the_worker_forecasts():
    lines = shown(
        {"event": "forecast", "seconds": {"capture": 30.0, "geometry": 10.0}},
        {"event": "status", "stage": "geometry", "message": "fitting"},
    )
    assert [line.split() for line in lines] == [["75%", "geometry", "fitting"]]


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a terminal")
def test_a_job_in_the_background_outlives_its_terminal():
    program = """
import os, sys
from cvdgs.core.runtime.cli import ConsoleReporter
from cvdgs.core.runtime.progress import RunProgress
from cvdgs.core.runtime.supervisor import BarDisplay, in_console
def work(listen):
    listen({"event": "status", "stage": "geometry", "message": "fitting"})
    print("begun", flush=True)
    sys.stdin.readline()
    listen({"event": "status", "stage": "geometry", "message": "still fitting"})
    listen({"event": "warning", "name": "moving-things", "message": "somebody walked by"})
    ConsoleReporter(sys.stderr).status("geometry", "still fitting")
    return {"out": "run"}
code = in_console(work, BarDisplay(sys.stderr, "run.py", RunProgress(("geometry",)), str))
print("done", flush=True)
sys.exit(code)
"""
    ours, its = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=its, text=True
    )
    os.close(its)
    assert process.stdout.readline() == "begun\n"
    os.close(ours)
    assert process.communicate("\n", timeout=SOON)[0] == "done\n"
    assert process.returncode == 0


def test_warnings_problems_and_the_result_have_lines_of_their_own():
    assert shown(
        {"event": "warning", "name": "video-cut", "message": "walk.mp4: the video breaks off"},
        {"event": "error", "kind": "input", "message": "no photographs"},
        {"event": "result", "out": "run"},
    ) == ["note: walk.mp4: the video breaks off", "run.py: no photographs", "done: run"]
