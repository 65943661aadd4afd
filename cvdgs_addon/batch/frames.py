"""Renders some pictures of a turntable of a finished run, which is loaded once; and what observers see of them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import bpy

from ...core.color.srgb import simulate_bytes
from ...core.files.untrusted import partial_file
from ...core.rendering.requests import FramesArguments
from ...core.runs.layout import picture_name
from ...core.runtime.protocol import Reporter
from ..scene.convert import LoadedRun, load_run
from ..scene.display import set_up_render
from ..scene.finished_run import read_run
from ..scene.remembered_settings import set_settings
from ..scene.render_settings import Display, Engine
from ..scene.splats import MODIFIER_NAME, show_layer
from ..scene.stills import render_picture, turned_to
from ..scene.turntable import Turntable, add_turntable, picture_settings
from .pixels import Observer, read_picture, remove_texts, write_picture

STAGE = "frames"


def render_frames(arguments: FramesArguments, out: Path, *, threads: int, reporter: Reporter) -> dict[str, Any]:
    """Render the pictures, each as `arguments` say, whatever is there already; replaces the file that is open.

    Args:
        arguments: of the task; paths from `out`.
        out: folder of the batch.
        threads: of the renderer; 0: as many as the processor has.
        reporter: hears of each picture.

    Returns:
        ``pictures``, ``engine`` and ``seconds``: of loading, and of each picture whole and for the render alone.

    Raises:
        InputError: the run cannot be used, or has no such layer.
        OSError: a picture cannot be written.
        RuntimeError: Blender could not render.
    """
    started = time.monotonic()
    reporter.status(STAGE, "loading the run")
    scene, loaded = _scene_of(out / arguments.run, arguments.layer)
    camera = add_turntable(scene, loaded.splats, turntable_of(arguments))
    _set_up(scene, camera, arguments, threads)
    model, simulated = arguments.model, arguments.simulated
    observers = {Observer.from_name(name, model): out / folder for name, folder in simulated.items()}
    loading = time.monotonic() - started

    whole, render = [], []
    numbers = range(arguments.first, arguments.last + 1)
    for done, number in enumerate(numbers):
        reporter.progress(STAGE, done / len(numbers), f"picture {number} of {arguments.frames}")
        begun = time.monotonic()
        path = out / arguments.folder / picture_name(number)
        scene.frame_set(number)
        with turned_to(camera, loaded.empty, camera.parent):
            render_started = time.monotonic()
            render_picture(scene, path)
            render.append(time.monotonic() - render_started)
        remove_texts(path)
        _simulate(path, observers)
        whole.append(time.monotonic() - begun)
    reporter.progress(STAGE, 1.0, f"{len(numbers)} pictures")
    return {
        "pictures": len(numbers),
        "engine": arguments.engine,
        "seconds": {"loading": loading, "pictures": whole, "rendering": render},
    }


def turntable_of(arguments: FramesArguments) -> Turntable:
    """The turn that `arguments` describe."""
    values = {field.name: getattr(arguments, field.name) for field in fields(Turntable)}
    return Turntable(**{**values, "engine": Engine[arguments.engine.upper()]})


def half_made(arguments: FramesArguments, out: Path) -> list[Path]:
    """What a render that was cut short may have left."""
    folders = [out / folder for folder in (arguments.folder, *arguments.simulated.values())]
    numbers = range(arguments.first, arguments.last + 1)
    return [partial_file(folder / picture_name(number)) for folder in folders for number in numbers]


def _scene_of(run_folder: Path, layer: str) -> tuple[bpy.types.Scene, LoadedRun]:
    """An empty file with the run in the colours of `layer`."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    loaded = load_run(read_run(run_folder), scene)
    show_layer(loaded.splats, layer)
    # Nobody looks at a viewport, and the modifier would be evaluated for it on every frame.
    loaded.splats.modifiers[MODIFIER_NAME].show_viewport = False
    return scene, loaded


def _set_up(scene: bpy.types.Scene, camera: bpy.types.Object, arguments: FramesArguments, threads: int) -> None:
    turntable = turntable_of(arguments)
    assert turntable.engine is not None
    set_up_render(scene, turntable.engine, Display.PHOTO)
    set_settings(scene, picture_settings(camera, turntable))
    if threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", threads


def _simulate(path: Path, observers: Mapping[Observer, Path]) -> None:
    """Write what each observer sees of the picture `path` under its name into the observer's folder."""
    if not observers:
        return
    picture = read_picture(path)
    for observer, folder in observers.items():
        seen = simulate_bytes(picture, observer.cvd, observer.severity, observer.model)
        write_picture(folder / path.name, seen)
