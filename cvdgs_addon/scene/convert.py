"""A finished run becomes a Blender scene: `load_run` into an open file, `convert` as a job of its own."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

from ...core.capture.folder import CaptureView
from ...core.color import srgb
from ...core.errors import InputError
from ...core.runs.layout import BLEND_FILE, ORIGINAL, layer_still_file
from ...core.runtime.progress import Clock
from ...core.runtime.protocol import Reporter
from ...core.splats.gaussians import core_bounds
from .cameras import use_camera
from .display import BACKGROUND_PROPERTY, Form, match_display, show_form
from .finished_run import PARTIAL_FOLDER, RUN_PROPERTY, FinishedRun, read_run
from .import_capture import add_cameras
from .origin import BESIDE
from .placement import Found, metres_of_unit, placement
from .preview import shade_flat
from .render_settings import Display, set_background, set_cycles, set_display
from .splat_attributes import Attribute, is_gaussian, write_attribute
from .splats import add_gaussians, check_gaussians, show_layer
from .stills import is_full, render_still, turned_to

STAGE = "blender"


@dataclass(frozen=True)
class ConversionOptions:
    """How a run becomes a scene.

    Attributes:
        display: how colours get onto the screen of a scene of its own (`convert`); see `Display`.
        background: sRGB behind the Gaussians; None takes what they were trained over.
        view: key of the view that stills show; None takes the first.
        stills: whether to render a still of every layer.
        place: whether to set the capture upright and to a sensible size (see `placement`).
    """

    display: Display = Display.PHOTO
    background: tuple[float, float, float] | None = None
    view: str | None = None
    stills: bool = True
    place: bool = True


@dataclass(frozen=True)
class LoadedRun:
    """The objects that `load_run` made."""

    splats: bpy.types.Object
    cameras: dict[str, bpy.types.Object]  # by view key
    empty: bpy.types.Object


@dataclass(frozen=True)
class ConversionResult:
    """What `convert` wrote; paths are relative to the run folder, with forward slashes."""

    blend: str
    stills: list[str]
    view: str
    layers: list[str]
    gaussians: int
    display: str
    blender: str = field(default_factory=lambda: bpy.app.version_string)
    seconds: dict[str, float | None] = field(default_factory=dict)


def convert(
    run_folder: str | Path, *, reporter: Reporter, options: ConversionOptions = ConversionOptions()
) -> ConversionResult:
    """Write ``scene.blend`` and ``stills/<layer>.png`` into a finished run's folder.

    Replaces the file that is open in this Blender: meant for a process of its own (`worker`); inside an artist's
    session use `load_run`. Files appear under their names only when they are complete.

    Raises:
        InputError: the run cannot be read, the view does not exist, or the folder cannot be written.
    """
    clock = Clock()
    reporter.status(STAGE, "reading the run")
    run = read_run(run_folder)
    view = run.view(options.view) if options.view is not None else run.views[0]
    clock.lap("read")
    partial = run.folder / PARTIAL_FOLDER
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        try:
            return _convert_in(partial, run, view, options, reporter, clock)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise _cannot_write(run.folder, error) from error
    except RuntimeError as error:  # what bpy's operators raise, whatever the reason
        if not is_full(run.folder):
            raise
        raise _cannot_write(run.folder, error) from error


def load_run(run: FinishedRun, scene: bpy.types.Scene, options: ConversionOptions = ConversionOptions()) -> LoadedRun:
    """Add cameras and Gaussians of `run` to `scene`; render settings stay as they are.

    Collections and objects are called after the run. About a second for a million Gaussians. The first layer is shown,
    in colours that suit the scene's view transform.

    Raises:
        InputError: the run's Gaussians or cameras cannot be used.
    """
    check_gaussians(run.gaussians, run.layers, where=run.folder)
    center, _ = core_bounds(run.gaussians.means)
    found = Found(run.up, run.metres_per_unit)
    matrix = placement(run.views, center, found=found, metres=metres_of_unit(scene)) if options.place else np.eye(4)
    added = add_cameras(run.views, matrix, center, run.gaussians.means, scene, found, name=run.name)
    splats = add_gaussians(run.gaussians, run.layers, added.collection, f"{run.name} Gaussians")
    if run.floaters is not None:
        scores = np.zeros(len(splats.data.vertices), np.float32)
        scores[is_gaussian(splats.data)] = run.floaters
        write_attribute(splats.data, Attribute.FLOATER, "FLOAT", scores)
    splats.parent = added.empty
    splats[BACKGROUND_PROPERTY] = run.background
    match_display(scene)
    return LoadedRun(splats, added.cameras, added.empty)


def _convert_in(
    partial: Path, run: FinishedRun, view: CaptureView, options: ConversionOptions, reporter: Reporter, clock: Clock
) -> ConversionResult:
    """Make everything in the folder `partial`, then move it into place."""
    reporter.status(STAGE, f"placing {len(run.gaussians)} Gaussians")
    scene = _new_scene(run, options)
    loaded = load_run(run, scene, options)
    loaded.splats[RUN_PROPERTY] = BESIDE  # beside the scene, wherever the folder is taken
    camera = loaded.cameras[view.key]
    clock.lap("build")

    layers = [ORIGINAL, *run.layers]
    stills = layers if options.stills else []
    with turned_to(camera, loaded.empty):
        for index, layer in enumerate(stills):
            reporter.progress(STAGE, (index + 0.5) / (len(stills) + 1), f"rendering {layer}")
            show_layer(loaded.splats, layer)
            render_still(scene, camera, partial / layer_still_file(layer))
    clock.lap("stills")

    reporter.progress(STAGE, (len(stills) + 0.5) / (len(stills) + 1), f"saving {BLEND_FILE}")
    use_camera(scene, camera)
    show_layer(loaded.splats, layers[1] if run.layers else ORIGINAL)
    show_form(loaded.splats, Form.PREVIEW)
    _look_through_camera(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(partial / BLEND_FILE), compress=True, relative_remap=False)
    written = list(map(layer_still_file, stills))
    for name in (*written, BLEND_FILE):  # the scene vouches for the rest: last
        (run.folder / name).parent.mkdir(exist_ok=True)
        os.replace(partial / name, run.folder / name)
    clock.lap("save")
    reporter.progress(STAGE, 1.0, f"{BLEND_FILE} written")
    return ConversionResult(BLEND_FILE, written, view.key, layers, len(run.gaussians), options.display.value,
                            seconds=clock.seconds)  # fmt: skip


def _new_scene(run: FinishedRun, options: ConversionOptions) -> bpy.types.Scene:
    """An empty file whose scene renders Gaussians as they were trained."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    set_cycles(scene)
    set_display(scene, options.display)
    background = np.array(options.background if options.background is not None else run.background)
    set_background(scene, background if options.display is Display.PHOTO else srgb.decode(background))
    return scene


def _look_through_camera(scene: bpy.types.Scene) -> None:
    """Let the file open with the Gaussians' colours in every 3D view, seen through the active camera."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "VIEW_3D":
                    shade_flat(space)
                    space.region_3d.view_perspective = "CAMERA"


def _cannot_write(folder: Path, error: Exception) -> InputError:
    reason = getattr(error, "strerror", None) or "the disk is full"
    return InputError(
        f"scene and stills cannot be written ({reason})", where=folder, remedy="free space or check the permissions"
    )
