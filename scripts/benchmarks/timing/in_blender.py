"""What Blender does for these benchmarks (see `blender_worker`): times stills of a run, and imports of a file."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy

from ....core.runtime.protocol import Reporter
from ....core.splats.io.files import read_gaussians
from ....cvdgs_addon.scene.cameras import use_camera
from ....cvdgs_addon.scene.convert import LoadedRun, load_run
from ....cvdgs_addon.scene.display import set_up_render
from ....cvdgs_addon.scene.finished_run import read_run
from ....cvdgs_addon.scene.render_settings import Display, Engine, set_png
from ....cvdgs_addon.scene.splat_nodes import Input
from ....cvdgs_addon.scene.splats import MODIFIER_NAME, add_gaussians, set_input
from ....cvdgs_addon.scene.stills import render_picture, turned_to

STAGE = "stills"
IMPORT_STAGE = "import"


def time_stills(arguments: Mapping[str, Any], run_folder: Path, *, reporter: Reporter) -> dict[str, Any]:
    """Render stills in turns; replaces the file that is open.

    Args:
        arguments: ``view``, whose camera looks; ``gaussians``, how many of the most important are drawn; ``width`` and
            ``height`` in pixels; ``rounds``; ``engine``, "cycles" or "eevee".
        run_folder: of a finished run; nothing is written there.

    Returns:
        ``stills``: for each way ``hull`` ("instances" or "mesh"), ``axes`` ("own" or "camera"), and of each round
        ``seconds`` of the clock and ``processor_seconds`` of all threads.

    Raises:
        InputError: the run cannot be used, or has no such view.
        RuntimeError: Blender could not render.
    """
    scene, loaded, camera = _scene_of(arguments, run_folder)
    rounds, count = int(arguments["rounds"]), int(arguments["gaussians"])
    stills = [_Still(hull, axes) for axes in ("own", "camera") for hull in ("instances", "mesh")]
    for turn in range(rounds):
        for index, still in enumerate(stills):
            done = (turn * len(stills) + index) / (rounds * len(stills))
            reporter.progress(STAGE, done, f"{still.hull} in {still.axes} axes")
            set_input(loaded.splats, Input.MESH_LIMIT, count if still.hull == "mesh" else 0)
            with turned_to(camera, loaded.empty) if still.axes == "camera" else nullcontext():
                seconds, processor_seconds = _render(scene)
            still.seconds.append(seconds)
            still.processor_seconds.append(processor_seconds)
    return {"stills": [vars(still) for still in stills]}


@dataclass
class _Still:
    """A way of rendering the still, and what it took in each round."""

    hull: str
    axes: str
    seconds: list[float] = field(default_factory=list)
    processor_seconds: list[float] = field(default_factory=list)


def _scene_of(arguments: Mapping[str, Any], run_folder: Path) -> tuple[bpy.types.Scene, LoadedRun, bpy.types.Object]:
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    run = read_run(run_folder)
    view = run.view(str(arguments["view"]))
    loaded = load_run(run, scene)
    camera = loaded.cameras[view.key]
    use_camera(scene, camera)
    set_up_render(scene, Engine[str(arguments["engine"]).upper()], Display.PHOTO)
    set_png(scene)
    scene.render.resolution_x, scene.render.resolution_y = int(arguments["width"]), int(arguments["height"])
    loaded.splats.modifiers[MODIFIER_NAME].show_viewport = False
    set_input(loaded.splats, Input.BUDGET, int(arguments["gaussians"]))
    set_input(loaded.splats, Input.BUDGET_IN_RENDERS, True)
    return scene, loaded, camera


def _render(scene: bpy.types.Scene) -> tuple[float, float]:
    """Seconds of the clock and of the processor that a still takes, from F12 to the file."""
    with tempfile.TemporaryDirectory() as folder:
        started, processor_started = time.monotonic(), time.process_time()
        render_picture(scene, Path(folder) / "still.png")
        return time.monotonic() - started, time.process_time() - processor_started


def time_import(arguments: Mapping[str, Any], folder: Path, *, reporter: Reporter) -> dict[str, Any]:
    """Import a file several times into an empty scene; replaces the file that is open.

    Args:
        arguments: ``file``, its name; ``rounds``.
        folder: that it is in.

    Returns:
        ``rounds``: of each the seconds of ``read``, ``add`` (the object with its attributes and nodes) and
        ``evaluate`` (what the nodes make for the viewport).

    Raises:
        InputError: the file cannot be read.
    """
    rounds = int(arguments["rounds"])
    found = []
    for turn in range(rounds):
        reporter.progress(IMPORT_STAGE, turn / rounds, f"round {turn + 1} of {rounds}")
        bpy.ops.wm.read_homefile(use_empty=True)
        marks = [time.perf_counter()]
        gaussians = read_gaussians(folder / str(arguments["file"]))
        marks.append(time.perf_counter())
        add_gaussians(gaussians, {}, bpy.context.scene.collection)
        marks.append(time.perf_counter())
        bpy.context.view_layer.update()
        marks.append(time.perf_counter())
        seconds = [after - before for before, after in pairwise(marks)]
        found.append(dict(zip(("read", "add", "evaluate"), seconds, strict=True)))
    return {"rounds": found}


def perform(request: dict[str, Any], reporter: Reporter) -> dict[str, Any]:
    """Do what `request` asks for; returns the fields of the result."""
    work = {"time-stills": time_stills, "time-import": time_import}[request["job"]]
    return work(request["arguments"], Path(request["out"]), reporter=reporter)
