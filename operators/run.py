"""Operators of the sub-panels "Make CVD-friendly" and "Report": start and cancel a run, show a finished one."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core.errors import InputError
from ..core.runs.layout import REPORT_PAGE
from ..cvdgs_addon import making
from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.folders import normalised_folder
from ..cvdgs_addon.shown import shown_run
from .base import NOT_REPEATED, Action, NeedsRun


class CVDGS_OT_make_cvd_friendly(Action, bpy.types.Operator):
    """Reconstruct the photographs as Gaussians in colours that the viewer can tell apart. Runs in the background"""

    bl_idname = "cvdgs.make_cvd_friendly"
    bl_label = "Make CVD-friendly"
    bl_options = NOT_REPEATED

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        capture = context.scene.cvdgs.capture
        if ACTIVITY.running(making.JOB):
            return "A run is already in progress; wait for it or cancel it"
        if not capture.folder:
            return "Choose a folder of photographs under Capture first"
        return f"The capture cannot be used: {capture.problem}" if capture.problem else ""

    def act(self, context: bpy.types.Context) -> None:
        making.run_now(context.scene)

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> None:
        making.start_run(context.scene)


class CVDGS_OT_resume_run(Action, bpy.types.Operator):
    """Go on with the run that was cancelled or broken off, from its latest checkpoint and with its settings"""

    bl_idname = "cvdgs.resume_run"
    bl_label = "Resume"
    bl_options = NOT_REPEATED

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        if ACTIVITY.running(making.JOB):
            return "A run is already in progress; wait for it or cancel it"
        return "" if making.broken_off_run(context.scene) else "No run was broken off in the output folder"

    def act(self, context: bpy.types.Context) -> None:
        making.run_now(context.scene, goes_on=True)

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> None:
        making.start_run(context.scene, goes_on=True)


class CVDGS_OT_cancel_job(Action, bpy.types.Operator):
    """Cancel this background job; nothing half-written is left behind, and Resume goes on with a run"""

    bl_idname = "cvdgs.cancel_job"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    job: bpy.props.StringProperty(name="Job", description="Name of the job to cancel", default=making.JOB)

    def act(self, _context: bpy.types.Context) -> set[str] | None:
        job = ACTIVITY.running(self.job)
        if job is None:
            self.report({"INFO"}, "No job is running")
            return {"CANCELLED"}
        job.cancel()
        return None


class CVDGS_OT_load_run(Action, bpy.types.Operator):
    """Load a finished run with its cameras, Gaussians and colour layers"""

    bl_idname = "cvdgs.load_run"
    bl_label = "Load Finished Run"

    directory: bpy.props.StringProperty(name="Run", description="Output folder of the run", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def act(self, context: bpy.types.Context) -> None:
        folder = normalised_folder(self.directory)
        splats = making.load_run(folder, context.scene)
        self.report({"INFO"}, f"Loaded {splats.name} from {folder}")

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str] | None:
        self.directory = shown_run(context) or making.output_folder(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class CVDGS_OT_open_report(NeedsRun, bpy.types.Operator):
    """Open the run's report in the web browser: images side by side, all figures, timings"""

    bl_idname = "cvdgs.open_report"
    bl_label = "Open Report"
    bl_options = set()

    def act(self, context: bpy.types.Context) -> None:
        page = Path(shown_run(context), REPORT_PAGE)
        if not page.is_file():
            raise InputError("there is no report", where=page, remedy="load the run again from its current folder")
        bpy.ops.wm.url_open(url=page.as_uri())


CLASSES: tuple[type, ...] = (
    CVDGS_OT_make_cvd_friendly,
    CVDGS_OT_resume_run,
    CVDGS_OT_cancel_job,
    CVDGS_OT_load_run,
    CVDGS_OT_open_report,
)
