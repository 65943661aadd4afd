"""The task that makes the page of a whole batch: its previews by Blender, its markup by the worker, which has Jinja2.

The page shows the turntables playing, layers and observers to switch, and the figures. Standard library only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..rendering.frames import simulation_model, to_stderr
from ..rendering.requests import PageArguments
from ..runs.layout import ORIGINAL
from ..runtime.process import Workers
from ..runtime.supervisor import Listener, finish
from .previews import Preview, make_previews
from .task import Task


def run(task: Task, out: Path, listen: Listener) -> None:
    """Make the page of what is there; what is not is said to be missing.

    Raises:
        InputError: the page cannot be written.
        WorkerDefect: Blender failed to make the videos.
        Cancelled: nothing half-written is left.
    """
    arguments = PageArguments.from_dict(task.arguments)
    previews = {preview for item in arguments.items for _, preview in shown_turntables(item, out)}
    make_previews(sorted(previews, key=lambda preview: preview.columns), out, listen)
    listen({"event": "status", "stage": "page", "message": f"writing {arguments.file}"})
    request = {"job": "batch-page", "arguments": arguments.to_dict(), "folder": str(out)}
    finish(Workers().start_page(request, to_stderr), listen)


def shown_turntables(item: Mapping[str, Any], out: Path) -> Iterator[tuple[Mapping[str, Any], Preview]]:
    """The turntables of an item that the page shows, each with its preview.

    A layer stands beside the original colours of the same camera and engine; those are shown alone where there is no
    layer.
    """
    turntables = item["turntables"]
    originals = {(turn["engine"], turn["camera"]): turn for turn in turntables if turn["layer"] == ORIGINAL}
    has_layers = any(turn["layer"] != ORIGINAL for turn in turntables)
    model = simulation_model(out / item["run"])
    for turn in turntables:
        observer = "" if turn["layer"] == ORIGINAL else turn["layer"]
        if not observer and has_layers:
            continue
        original = originals.get((turn["engine"], turn["camera"])) if observer else None
        columns = tuple(shown["folder"] for shown in (original, turn) if shown is not None)
        yield turn, Preview(columns, int(turn["frames"]), int(turn["frames_per_second"]), observer, model)
