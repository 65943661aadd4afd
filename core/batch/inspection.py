"""Looks at the captures of a batch before anything starts, so that a night is not lost. Standard library only.

What `read_batch` sees of a capture is that its folder exists; whether it has photographs with cameras is the worker's
knowledge. One worker looks at all of them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from ..job import Workers
from ..job_console import Listener, finish
from .model import Batch
from .table_reader import Problem, UnusableFile
from .toml_lines import LineNumbers

STAGE = "check"


def check_captures(batch: Batch, path: Path, listen: Listener) -> None:
    """Make sure that every capture of `batch`, which the file `path` describes, can be read.

    Raises:
        UnusableFile: with what is wrong with each of them, photographs' pixels aside.
        InputError: there is no Python that could train.
        WorkerDefect: the worker failed.
    """
    places = [place for place, item in enumerate(batch.items) if item.capture is not None]
    if not places:
        return
    items = [batch.items[place] for place in places]
    captures = [{"capture": str(item.capture), "sfm": bool(item.train.get("sfm", False))} for item in items]
    listen({"event": "status", "stage": STAGE, "message": f"captures to look at: {len(captures)}"})
    request = {"job": "inspect-all", "captures": captures}
    refusals = finish(Workers().start(request, _log), listen)["refusals"]
    if any(refusals):
        lines = LineNumbers(path.read_text(encoding="utf-8"))
        found = zip(places, refusals, strict=True)
        raise UnusableFile(
            path,
            [
                Problem(lines[("items", place, "capture")], f"items[{place + 1}].capture: {refusal}")
                for place, refusal in found
                if refusal
            ],
        )


def _log(line: str) -> None:
    print(line, file=sys.stderr)
