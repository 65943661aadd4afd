"""The button "Make CVD-friendly": from the panels' settings to a run in the background, and its result in the scene."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..core.capture.sfm_job import SfmSettings
from ..core.color.matrices import check_simulation
from ..core.errors import InputError
from ..core.intake.sampling import likely_frames
from ..core.pipeline import launch
from ..core.pipeline.continuation import broken_off
from ..core.runs.layout import CAPTURE_FOLDER
from ..core.runtime.process import Workers
from ..core.runtime.progress import CAMERAS, COMPILING, STARTING
from ..core.runtime.supervisor import Listener
from ..core.runtime.time_model import TIME_MODEL
from ..core.settings import Layer, Settings
from .activity import ACTIVITY, redraw_panels, remember_for_undo, scene_by_uid
from .background import BackgroundJob, State
from .environment import make_workers
from .folders import folder_beside, normalised_folder
from .messages import show_information, show_problem
from .pictures import PICTURES
from .preferences import get_preferences, learned_stage_speeds, machine_speed, remember, shrink_cache
from .quality import Quality, expected_seconds, in_words, learned_speeds, quality_called
from .results import is_finished_run, read_report, show_run

JOB = "run"
PREVIEW = "run preview"
"""Key in `PICTURES` of the latest picture of the run."""

_SEVERITY_DIGITS = 2  # of a layer's name; a slider gives more than anybody sees


def output_folder(scene: bpy.types.Scene) -> str:
    """Where the results of `scene` go: the chosen folder, or one beside the capture; "" while there is neither."""
    properties = scene.cvdgs
    if properties.run.out:
        return normalised_folder(properties.run.out)
    if not properties.capture.folder:
        return ""
    return folder_beside(properties.capture.folder, "CVD")


def viewer_layer(scene: bpy.types.Scene) -> Layer:
    """The colour layer for the viewer of `scene`."""
    viewer = scene.cvdgs.viewer
    return Layer(viewer.cvd, round(viewer.severity, _SEVERITY_DIGITS))


def adds_to_run(scene: bpy.types.Scene) -> bool:
    """Whether the button adds a layer to a finished run instead of making a new one."""
    return not scene.cvdgs.run.start_over and is_finished_run(output_folder(scene))


def run_settings(scene: bpy.types.Scene) -> Settings:
    """What the button asks the worker for.

    Raises:
        InputError: something is missing or does not fit.
    """
    properties = scene.cvdgs
    if not properties.capture.folder:
        raise InputError("no capture is chosen", where="Capture", remedy="choose a folder of photographs or a video")
    layer = viewer_layer(scene)
    check_simulation(layer.cvd, layer.severity, properties.viewer.simulation)
    adds = adds_to_run(scene)
    settings = {
        "capture": bpy.path.abspath(properties.capture.folder),
        "out": output_folder(scene),
        "layers": (layer,),
        "simulation": properties.viewer.simulation,
        "strength": properties.viewer.strength,
        "enhancer": properties.run.enhancer,
        "device": get_preferences().device,
        "cameras": properties.capture.cameras.lower(),
        "blend": properties.run.scene_file,
        "resume": adds,
    }
    if adds and has_layer(scene):
        remedy = "load the run, choose another viewer, or tick Start Over"
        raise InputError(f"the run already has the layer {layer.name}", where=output_folder(scene), remedy=remedy)
    if not adds:
        quality = quality_called(properties.run.quality)
        refine_poses = properties.run.refine_poses
        settings |= {"iterations": quality.iterations, "max_size": quality.max_size, "refine_poses": refine_poses}
    return Settings(**settings)


def broken_off_run(scene: bpy.types.Scene) -> Settings | None:
    """What goes on with the run that was broken off in the output folder; None where there is none that can."""
    out = output_folder(scene)
    return broken_off(out) if out else None


def estimated_seconds(scene: bpy.types.Scene, quality: Quality) -> float | None:
    """How long the button will take on this machine, or None while the capture is not known."""
    if not scene.cvdgs.capture.inspected:
        return None
    return sum(_here(_reference_seconds(scene, quality)).values())


def start_run(scene: bpy.types.Scene, *, goes_on: bool = False) -> None:
    """Make `scene` CVD-friendly in the background; `goes_on`: with the run that was broken off.

    Raises:
        InputError: something is missing or does not fit.
    """
    settings, adds = _asked(scene, goes_on)
    PICTURES.forget(PREVIEW)
    reference = _reference_seconds(scene, quality_called(scene.cvdgs.run.quality))
    stages = launch.stages_of(replace(settings, resume=adds))
    expected = _here(reference) if scene.cvdgs.capture.views else None
    job = BackgroundJob("Make CVD-friendly", partial(_run, settings), make_workers(), stages, expected)
    known = reference if scene.cvdgs.capture.inspected and not goes_on else {}
    take_over = partial(_take_over, scene.session_uid, settings, known, not adds)
    ACTIVITY.start(JOB, job, take_over, on_change=_PreviewLoader(), ends_with_file=True)


def run_now(scene: bpy.types.Scene, *, goes_on: bool = False) -> None:
    """Make `scene` CVD-friendly and wait for it, for scripts; `goes_on`: with the run that was broken off.

    Raises:
        InputError: something is missing, does not fit, or was refused by the worker.
        WorkerDefect: the worker failed.
    """
    settings, adds = _asked(scene, goes_on)
    _run(settings, make_workers(), lambda _: None)
    show_run(settings.out, scene, anew=not adds)


def load_run(folder: str, scene: bpy.types.Scene) -> bpy.types.Object:
    """Show the finished run in `folder`; returns the Gaussians' object.

    Where no capture is picked, the run's own is, so that the button adds layers to it.

    Raises:
        InputError: the run cannot be read or used, or its Gaussians are being edited.
    """
    splats = show_run(folder, scene)
    properties = scene.cvdgs
    if not properties.capture.folder:
        properties.run.out = folder
        properties.capture.folder = str(Path(folder, CAPTURE_FOLDER))
    return splats


def _asked(scene: bpy.types.Scene, goes_on: bool) -> tuple[Settings, bool]:
    """What to ask the worker for, and whether that adds a layer to a finished run.

    Raises:
        InputError: something is missing or does not fit, or there is no run to go on with.
    """
    if not goes_on:
        settings = run_settings(scene)
        return settings, settings.resume
    found = broken_off_run(scene)
    if found is None:
        raise InputError("no run was broken off here", where=output_folder(scene), remedy="start a new one")
    return replace(found, blend=scene.cvdgs.run.scene_file), False


class _PreviewLoader:
    """Loads every new picture of a run, for the panel."""

    def __init__(self) -> None:
        self._loaded = 0

    def __call__(self, job: BackgroundJob) -> None:
        if job.previews > self._loaded:
            self._loaded = job.previews
            PICTURES.load(PREVIEW, Path(job.preview))


def _run(settings: Settings, workers: Workers, listen: Listener) -> dict[str, Any]:
    return launch.run(settings, listen, workers, previews=True)


def has_layer(scene: bpy.types.Scene) -> bool:
    """Whether the run that is there has the viewer's layer already."""
    return viewer_layer(scene).name in read_report(output_folder(scene)).get("layers", {})


def _reference_seconds(scene: bpy.types.Scene, quality: Quality) -> dict[str, float]:
    """Seconds by stage that the button takes on the reference machine."""
    capture, adds = scene.cvdgs.capture, adds_to_run(scene)
    views = capture.views + likely_frames(capture.seconds)
    seconds = TIME_MODEL.stages(
        quality.iterations,
        quality.max_size,
        views,
        capture.width,
        capture.height,
        adds_layer=adds,
        scene_file=scene.cvdgs.run.scene_file,
    )
    if capture.format == "sfm" and not adds:
        estimation = SfmSettings.for_views(quality.max_size)
        seconds[CAMERAS] = estimation.seconds(views, capture.width, capture.height)
    return seconds


def _here(reference: Mapping[str, float]) -> dict[str, float]:
    """Seconds by stage on this machine."""
    return expected_seconds(reference, machine_speed(), learned_stage_speeds())


def _learn(reference: Mapping[str, float], taken: Mapping[str, float | None]) -> None:
    """Let the next estimate know what a run has taken by stage."""
    speeds = learned_speeds(learned_stage_speeds(), reference, taken)
    remember(stage_speeds=json.dumps(speeds))


def _take_over(
    scene_uid: int, settings: Settings, reference: Mapping[str, float], anew: bool, job: BackgroundJob
) -> None:
    PICTURES.forget(PREVIEW)
    if job.state is State.CANCELLED:
        _learn(reference, job.progress.stage_seconds())
    if job.state is State.FAILED:
        show_problem(job.title, job.problem)
    if job.state is not State.DONE:
        return
    by_stage = dict(launch.latest_seconds(job.result))
    seconds = by_stage.pop("total") or 0.0
    if seconds:
        told = job.progress.stage_seconds()
        start = max(seconds - told.get(COMPILING, 0.0) - sum(part or 0.0 for part in by_stage.values()), 0.0)
        taken = {**by_stage, STARTING: start}
        if cameras := told.get(CAMERAS, 0.0):  # in a report part of reading the capture
            taken |= {CAMERAS: cameras, "capture": max((by_stage.get("capture") or 0.0) - cameras, 0.0)}
        _learn(reference, taken)
    shrink_cache()
    scene = scene_by_uid(scene_uid)
    if scene is None:
        show_information(job.title, f"The scene no longer exists; the result is in {settings.out}")
        return
    try:
        show_run(settings.out, scene, anew=anew)
    except InputError as error:
        show_problem(job.title, str(error))
        return
    remember_for_undo(job.title)
    redraw_panels()
    took = in_words(seconds).removeprefix("about ")
    message = f"{settings.layers[0].name} is ready after {took}"
    show_information(job.title, message)
