"""Sub-panel "Capture": choose a folder, see what it holds, and bring it into the scene."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.activity import ACTIVITY
from ..cvdgs_addon.folders import normalised_folder
from ..cvdgs_addon.importing import JOB as IMPORT_JOB
from ..cvdgs_addon.inspection import JOB as INSPECTION_JOB
from ..cvdgs_addon.inspection import thumbnails_of
from ..cvdgs_addon.messages import sentence
from ..cvdgs_addon.pictures import PICTURES
from .layout import SidePanel, complain, say, say_end
from .run import draw_progress

_FORMATS = {"colmap": "COLMAP", "transforms": "transforms.json", "sfm": "No cameras; they will be estimated"}
_THUMBNAILS_A_ROW = 2


class CVDGS_PT_capture(SidePanel, bpy.types.Panel):
    """The photographs, video or zip to start from."""

    bl_idname = "CVDGS_PT_capture"
    bl_label = "Capture"

    def draw(self, context: bpy.types.Context) -> None:
        layout, capture = self.layout, context.scene.cvdgs.capture
        row = layout.row(align=True)
        row.prop(capture, "folder", text="")
        row.operator("cvdgs.choose_capture_file", text="", icon="FILE_MOVIE")
        row.operator("cvdgs.inspect_capture", text="", icon="FILE_REFRESH")
        if not capture.folder:
            say(layout, context, "Choose a folder of photographs, a video or a zip", "INFO")
            layout.operator("cvdgs.use_demo", icon="PACKAGE")
            return
        if ACTIVITY.running(INSPECTION_JOB):
            say(layout, context, "Reading the folder …", "TIME")
        elif capture.problem:
            # The folder's name stands above, and is long.
            complain(layout, context, sentence(capture.problem.removeprefix(f"{normalised_folder(capture.folder)}: ")))
            if capture.cameras != "AUTO" or "--cameras" in capture.problem:
                layout.prop(capture, "cameras")
        elif capture.inspected:
            _draw_summary(layout, context, capture)
        else:
            say(layout, context, "Not read yet: press the arrows beside the folder", "INFO")


def _draw_summary(layout: bpy.types.UILayout, context: bpy.types.Context, capture: bpy.types.PropertyGroup) -> None:
    column = layout.column(align=True)
    column.label(text=f"{_material(capture)}, {capture.sizes} pixels", icon="CHECKMARK")
    column.label(text=_FORMATS.get(capture.format, capture.format), icon="OUTLINER_OB_CAMERA")
    if capture.points:
        column.label(text=f"{capture.points:,} sparse points", icon="OUTLINER_OB_POINTCLOUD")
    if capture.format == "sfm" or capture.cameras != "AUTO":
        layout.prop(capture, "cameras")
    grid = layout.grid_flow(row_major=True, columns=_THUMBNAILS_A_ROW, even_columns=True, align=True)
    for key in thumbnails_of(capture):
        grid.template_icon(icon_value=PICTURES.icon(key), scale=5.6)
    for warning in capture.warnings.splitlines():
        say(layout, context, warning, "ERROR")


def _material(capture: bpy.types.PropertyGroup) -> str:
    videos = f"{capture.videos} video{'s' if capture.videos > 1 else ''} of {capture.seconds:.0f} s"
    parts = [f"{capture.views} photographs" if capture.views or not capture.videos else "", videos]
    return " and ".join(filter(None, parts if capture.videos else parts[:1]))


class CVDGS_PT_import_capture(SidePanel, bpy.types.Panel):
    """The capture's cameras, photographs and points in Blender, upright and in their true size."""

    bl_idname = "CVDGS_PT_import_capture"
    bl_parent_id = "CVDGS_PT_capture"
    bl_label = "In the Scene"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, job = self.layout, ACTIVITY.job(IMPORT_JOB)
        if job is not None and job.is_running:
            draw_progress(layout, context, job, IMPORT_JOB)
            return
        layout.operator("cvdgs.import_capture", icon="OUTLINER_OB_CAMERA")
        say_end(layout, context, job)
        column = layout.column()
        column.enabled = bpy.ops.cvdgs.place_capture.poll()  # a menu does not ask
        column.operator_menu_enum("cvdgs.place_capture", "up", text="Up Axis", icon="ORIENTATION_GLOBAL")
        row = column.row(align=True)
        row.operator("cvdgs.add_ruler", icon="ARROW_LEFTRIGHT")
        row.operator("cvdgs.measure")
        row = layout.row(align=True)
        row.operator("cvdgs.look_through", text="Previous Camera", icon="TRIA_LEFT").step = -1
        row.operator("cvdgs.look_through", text="Next Camera", icon="TRIA_RIGHT").step = 1


CLASSES: tuple[type, ...] = (CVDGS_PT_capture, CVDGS_PT_import_capture)
