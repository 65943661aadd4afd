"""The turntable of a run: pictures from all around, in every layer, by Blender. Standard library only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..runs.folder import remove_folder
from ..runs.layout import ORIGINAL, TURNTABLE_FOLDER
from ..runtime.process import Event, Workers
from ..runtime.supervisor import Listener, Log
from ..settings import Settings
from . import frames
from .requests import FramesArguments, Orbit

STAGE = "turntable"


def render_turntables(
    folder: Path, report: dict[str, Any], settings: Settings, workers: Workers, log: Log
) -> dict[str, Any]:
    """Render the turntable of every layer into ``turntable/<layer>/0001.png`` and so on.

    Turntables of as many pictures by the same engine on the same orbit stay.

    Args:
        folder: of the run, with its Gaussians and capture.
        report: of the run.
        log: receives the progress.

    Returns:
        What the report says of it: the number of pictures of a turn, the layers, the engine that was asked for, and the
        orbit.

    Raises:
        InputError: there is no Blender.
        WorkerDefect: Blender failed.
        Cancelled: nothing half-written is left.
    """
    layers = [ORIGINAL, *report["layers"]]
    made_by = {"engine": settings.engine, "orbit": vars(Orbit())}  # pictures of two do not go together
    earlier = report.get(STAGE) or {}
    kept = {name: earlier.get(name) for name in made_by} == made_by
    there = [layer for layer in layers if kept and _is_there(folder / TURNTABLE_FOLDER / layer, settings.turntable)]
    missing = [layer for layer in layers if layer not in there]
    for done, layer in enumerate(missing):
        remove_folder(folder / TURNTABLE_FOLDER / layer)
        arguments = FramesArguments.on(
            Orbit(),
            run=".",
            layer=layer,
            engine=settings.engine,
            folder=f"{TURNTABLE_FOLDER}/{layer}",
            first=1,
            last=settings.turntable,
            frames=settings.turntable,
            width=report["capture"]["width"],
            height_pixels=report["capture"]["height"],
            simulated={},
            model="",
        )
        listen = _as_part_of_stage(log.event, layer, done, len(missing))
        frames.render(arguments, folder, listen, threads=0, workers=workers, log=log.line)
    return {"frames": settings.turntable, "layers": layers, **made_by}


def _is_there(folder: Path, count: int) -> bool:
    return len(list(folder.glob("*.png"))) == count


def _as_part_of_stage(listen: Listener, layer: str, done: int, count: int) -> Listener:
    """What a layer's pictures report, as progress of the whole stage."""

    def hear(event: Event) -> None:
        if event["event"] in ("status", "progress"):
            event = {**event, "stage": STAGE, "message": f"{layer}: {event['message']}"}
        if event["event"] == "progress":
            event |= {"fraction": (done + event["fraction"]) / count, "seconds_left": None}
        listen(event)

    return hear
