"""Operators of the sub-panel "Make CVD-friendly": the button, its end, and runs that have finished."""

from __future__ import annotations

import bpy

from ..cvdgs_addon import making
from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.folders import normalised_folder
from ..cvdgs_addon.shown import shown_run
from .base import reports_errors


class CVDGS_OT_make_cvd_friendly(bpy.types.Operator):
    """Reconstruct the photographs as Gaussians in colours that the viewer can tell apart; Blender stays usable"""

    bl_idname = "cvdgs.make_cvd_friendly"
    bl_label = "Make CVD-friendly"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        capture = context.scene.cvdgs.capture
        if ACTIVITY.running(making.JOB):
            cls.poll_message_set("A run goes on; wait for it or cancel it")
            return False
        if not capture.folder:
            cls.poll_message_set("Pick a folder of photographs under Capture first")
            return False
        if capture.problem:
            cls.poll_message_set(f"The capture cannot be used: {capture.problem}")
            return False
        return True

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        making.run_now(context.scene)
        return {"FINISHED"}

    @reports_errors
    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        making.start_run(context.scene)
        return {"FINISHED"}


class CVDGS_OT_cancel_job(bpy.types.Operator):
    """End what goes on in the background; nothing half-written stays"""

    bl_idname = "cvdgs.cancel_job"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    job: bpy.props.StringProperty(name="Job", description="Which one", default=making.JOB)

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return True

    def execute(self, _context: bpy.types.Context) -> set[str]:
        job = ACTIVITY.running(self.job)
        if job is None:
            self.report({"INFO"}, "Nothing goes on")
            return {"CANCELLED"}
        job.cancel()
        return {"FINISHED"}


class CVDGS_OT_load_run(bpy.types.Operator):
    """Show a finished run: its cameras, its Gaussians and all its colour layers"""

    bl_idname = "cvdgs.load_run"
    bl_label = "Load Finished Run"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(name="Run", description="Output folder of the run", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        folder = normalised_folder(self.directory)
        splats = making.load_run(folder, context.scene)
        self.report({"INFO"}, f"{splats.name}: loaded from {folder}")
        return {"FINISHED"}

    @reports_errors
    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.directory = shown_run(context) or making.output_folder(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


CLASSES: tuple[type, ...] = (CVDGS_OT_make_cvd_friendly, CVDGS_OT_cancel_job, CVDGS_OT_load_run)
