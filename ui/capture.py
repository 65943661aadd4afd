"""Sub-panel "Capture": pick a folder, see what it holds."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.folders import normalised_folder
from ..cvdgs_addon.inspection import JOB, thumbnails_of
from ..cvdgs_addon.messages import sentence
from ..cvdgs_addon.pictures import PICTURES
from .layout import SidePanel, complain, say

_FORMATS = {"colmap": "COLMAP", "transforms": "transforms.json", "sfm": "photographs, cameras to be estimated"}
_THUMBNAILS_A_ROW = 2


class CVDGS_PT_capture(SidePanel, bpy.types.Panel):
    """Photographs with known cameras."""

    bl_idname = "CVDGS_PT_capture"
    bl_label = "Capture"

    def draw(self, context: bpy.types.Context) -> None:
        layout, capture = self.layout, context.scene.cvdgs.capture
        row = layout.row(align=True)
        row.prop(capture, "folder", text="")
        row.operator("cvdgs.inspect_capture", text="", icon="FILE_REFRESH")
        if not capture.folder:
            say(layout, context, "Pick a folder of photographs with cameras: COLMAP or transforms.json", "INFO")
            layout.operator("cvdgs.use_demo", icon="PACKAGE")
            return
        if ACTIVITY.running(JOB):
            say(layout, context, "Looking at the folder …", "TIME")
        elif capture.problem:
            # The folder's name stands above, and is long.
            complain(layout, context, sentence(capture.problem.removeprefix(f"{normalised_folder(capture.folder)}: ")))
            if capture.sfm or "--sfm" in capture.problem:
                layout.prop(capture, "sfm")
        elif capture.inspected:
            _draw_summary(layout, context, capture)
        else:
            say(layout, context, "Not looked at yet: press the arrows beside the folder", "INFO")


def _draw_summary(layout: bpy.types.UILayout, context: bpy.types.Context, capture: bpy.types.PropertyGroup) -> None:
    column = layout.column(align=True)
    column.label(text=f"{capture.views} views, {capture.sizes} pixels", icon="CHECKMARK")
    column.label(text=_FORMATS.get(capture.format, capture.format), icon="OUTLINER_OB_CAMERA")
    if capture.points:
        column.label(text=f"{capture.points:,} sparse points", icon="OUTLINER_OB_POINTCLOUD")
    if capture.format == "sfm":
        layout.prop(capture, "sfm")
    grid = layout.grid_flow(row_major=True, columns=_THUMBNAILS_A_ROW, even_columns=True, align=True)
    for key in thumbnails_of(capture):
        grid.template_icon(icon_value=PICTURES.icon(key), scale=5.6)
    for warning in capture.warnings.splitlines():
        say(layout, context, warning, "ERROR")


CLASSES: tuple[type, ...] = (CVDGS_PT_capture,)
