"""Sub-panel "Make CVD-friendly": the button, what it will take, and how far it is."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..core.runtime.progress import format_seconds
from ..cvdgs_addon import making
from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.background import BackgroundJob
from ..cvdgs_addon.environment import worker_python
from ..cvdgs_addon.folders import PACKAGE
from ..cvdgs_addon.messages import sentence
from ..cvdgs_addon.pictures import PICTURES
from ..cvdgs_addon.quality import QUALITIES, Quality, in_words
from ..cvdgs_addon.results import is_finished_run, splats_of
from .layout import SidePanel, complain, say, say_end, split_column

_PREVIEW_SCALE = 11.4
_STAGES = {
    "start": "Starting",
    "cameras": "Finding the cameras",
    "capture": "Reading the photographs",
    "kernels": "Preparing",
    "lens": "Checking the cameras",
    "enhance": "Finding new colours",
    "geometry": "Reconstructing",
    "layers": "Colouring the scene",
    "evaluate": "Measuring",
    "blender": "Scene file and stills",
}


class CVDGS_PT_run(SidePanel, bpy.types.Panel):
    """From photographs to a scene in colours that can be told apart."""

    bl_idname = "CVDGS_PT_run"
    bl_label = "Make CVD-friendly"

    def draw(self, context: bpy.types.Context) -> None:
        layout, job = self.layout, ACTIVITY.job(making.JOB)
        if job is not None and job.is_running:
            draw_progress(layout, context, job, making.JOB)
            _draw_preview(layout)
            for warning in job.warnings:
                say(layout, context, warning, "ERROR")
            return
        capture = context.scene.cvdgs.capture
        if not capture.folder:
            say(layout, context, "Choose a folder of photographs under Capture first", "INFO")
        elif capture.problem:
            say(layout, context, "The capture cannot be used; see Capture above", "INFO")
        else:
            _draw_choices(layout, context)
        say_end(layout, context, job)
        layout.operator("cvdgs.load_run", icon="FILE_FOLDER")


def draw_progress(layout: bpy.types.UILayout, context: bpy.types.Context, job: BackgroundJob, name: str) -> None:
    """A bar with the stage and the time left, and a button to cancel."""
    progress = job.progress
    stage = _STAGES.get(progress.stage, job.title)
    left = progress.seconds_left
    column = layout.column(align=True)
    column.label(text="Cancelling …" if job.is_cancelling else stage, icon="TIME")
    text = f"{progress.fraction:.0%}" + (f", {format_seconds(left)} left" if left is not None else "")
    row = column.row(align=True)
    row.progress(factor=progress.fraction, text=text)
    cancel = row.row(align=True)
    cancel.enabled = not job.is_cancelling
    cancel.operator("cvdgs.cancel_job", text="", icon="X").job = name
    if progress.message:
        say(layout, context, sentence(progress.message))


def _draw_preview(layout: bpy.types.UILayout) -> None:
    if making.PREVIEW in PICTURES:
        layout.template_icon(icon_value=PICTURES.icon(making.PREVIEW), scale=_PREVIEW_SCALE)


def _draw_choices(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    scene, properties = context.scene, context.scene.cvdgs.run
    layer = making.viewer_layer(scene).name
    try:
        worker_python()
    except InputError as error:
        complain(layout, context, str(error))
        layout.operator("preferences.addon_show", text="Open Preferences", icon="PREFERENCES").module = PACKAGE
        return
    _draw_output(layout, context)
    goes_on = _draw_resume(layout, context)
    if not making.adds_to_run(scene):
        column = layout.column(align=True)
        for quality in QUALITIES:
            column.prop_enum(properties, "quality", quality.name, text=f"{quality.label}{_time(scene, quality)}")
        _draw_button(layout, "Start Over" if goes_on else "Make CVD-friendly")
    elif making.has_layer(scene):
        say(layout, context, f"The run in the output folder already has {layer}: {_what_next(scene)}", "CHECKMARK")
    else:
        say(layout, context, f"{layer} will be added as a new layer to the run in the output folder", "INFO")
        _draw_button(layout, f"Add {layer}{_time(scene, QUALITIES[0])}")
    if is_finished_run(making.output_folder(scene)):
        layout.prop(properties, "start_over")
    _draw_options(layout, scene)


def _draw_options(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    header, body = layout.panel("cvdgs_run_options", default_closed=True)
    header.label(text="Options")
    if body is not None:
        body = split_column(body)
        body.prop(scene.cvdgs.run, "enhancer")
        if not making.adds_to_run(scene):
            body.prop(scene.cvdgs.run, "refine_poses")
        body.prop(scene.cvdgs.run, "scene_file")


def _draw_resume(layout: bpy.types.UILayout, context: bpy.types.Context) -> bool:
    """Offer to go on with a run that was broken off here; returns whether there is one."""
    run = making.broken_off_run(context.scene)
    if run is None:
        return False
    layers = ", ".join(layer.name for layer in run.layers)
    say(layout, context, f"A run for {layers} was broken off here; it can go on where it was", "INFO")
    row = layout.row()
    row.scale_y = 1.5
    row.operator("cvdgs.resume_run", icon="PLAY")
    return True


def _draw_output(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Where the results go, before somebody starts what makes them."""
    properties = context.scene.cvdgs.run
    split_column(layout).prop(properties, "out")
    folder = making.output_folder(context.scene)
    if not properties.out:
        say(layout, context, f"Results will be written to {folder}")
    elif properties.out.startswith("//") and not bpy.data.filepath:
        say(layout, context, f"This file is not saved yet: results will be written to {folder}", "INFO")


def _what_next(scene: bpy.types.Scene) -> str:
    """What can be done with a run that has the viewer's layer."""
    choices = "choose another viewer to add a layer, or start over"
    is_shown = any(splats_of(scene, making.output_folder(scene)))
    return choices if is_shown else f"load it, {choices}"


def _draw_button(layout: bpy.types.UILayout, text: str) -> None:
    row = layout.row()
    row.scale_y = 1.5
    row.operator("cvdgs.make_cvd_friendly", text=text, icon="PLAY")


def _time(scene: bpy.types.Scene, quality: Quality) -> str:
    """What a button says of the time that it takes."""
    seconds = making.estimated_seconds(scene, quality)
    return "" if seconds is None else f", {in_words(seconds)}"
