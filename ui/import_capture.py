"""Sub-panel "In the Scene" of Capture: its cameras, photographs and sparse points as Blender objects."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.background import State
from ..cvdgs_addon.importing import JOB
from .layout import SidePanel, complain, say
from .run import draw_progress


class CVDGS_PT_import_capture(SidePanel, bpy.types.Panel):
    """The capture's cameras as Blender's."""

    bl_idname = "CVDGS_PT_import_capture"
    bl_parent_id = "CVDGS_PT_capture"
    bl_label = "In the Scene"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, job = self.layout, ACTIVITY.job(JOB)
        if job is not None and job.is_running:
            draw_progress(layout, context, job, JOB)
            return
        layout.operator("cvdgs.import_capture", icon="OUTLINER_OB_CAMERA")
        if job is not None and job.state is State.FAILED:
            complain(layout, context, job.problem)
        elif job is not None and job.state is State.CANCELLED:
            say(layout, context, "Cancelled; nothing was written", "INFO")
        column = layout.column()
        column.enabled = bpy.ops.cvdgs.place_capture.poll()  # a menu does not ask
        column.operator_menu_enum("cvdgs.place_capture", "up", text="Up Axis", icon="ORIENTATION_GLOBAL")
        row = layout.row(align=True)
        row.operator("cvdgs.look_through", text="Previous Camera", icon="TRIA_LEFT").step = -1
        row.operator("cvdgs.look_through", text="Next Camera", icon="TRIA_RIGHT").step = 1


CLASSES: tuple[type, ...] = (CVDGS_PT_import_capture,)
