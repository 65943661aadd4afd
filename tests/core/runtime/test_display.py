"""What a run tells the console."""

import io

from cvdgs.core.runtime.progress import RunProgress
from cvdgs.core.runtime.supervisor import BarDisplay


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


def test_warnings_problems_and_the_result_have_lines_of_their_own():
    assert shown(
        {"event": "warning", "name": "video-cut", "message": "walk.mp4: the video breaks off"},
        {"event": "error", "kind": "input", "message": "no photographs"},
        {"event": "result", "out": "run"},
    ) == ["note: walk.mp4: the video breaks off", "run.py: no photographs", "done: run"]
