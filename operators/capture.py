"""Operators of the sub-panel "Capture"."""

from __future__ import annotations

import bpy

from ..core.demo import SHOWROOM
from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.inspection import JOB, inspect_now, start_inspection
from .base import reports_errors


class CVDGS_OT_inspect_capture(bpy.types.Operator):
    """Look again at what the folder holds: format, views, sizes, warnings, and the first photographs"""

    bl_idname = "cvdgs.inspect_capture"
    bl_label = "Inspect Capture"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.cvdgs.capture.folder:
            cls.poll_message_set("Pick a folder of photographs first")
            return False
        if ACTIVITY.running(JOB):
            cls.poll_message_set("The folder is being looked at")
            return False
        return True

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        inspect_now(context.scene)
        return {"FINISHED"}

    @reports_errors
    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        start_inspection(context.scene)
        return {"FINISHED"}


class CVDGS_OT_use_demo(bpy.types.Operator):
    """Use the small capture of a textile showroom that comes with the add-on, to try things out"""

    bl_idname = "cvdgs.use_demo"
    bl_label = "Use the Demo"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.cvdgs.capture.sfm = False
        context.scene.cvdgs.capture.folder = str(SHOWROOM)
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (CVDGS_OT_inspect_capture, CVDGS_OT_use_demo)
