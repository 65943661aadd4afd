"""Operators of the sub-panel "Export": splat files and LUTs for other programs."""

from __future__ import annotations

import bpy
from bpy_extras.io_utils import ExportHelper

from ..cvdgs_addon.export import export_cube, export_gaussians, read_gaussians
from ..cvdgs_addon.shown import NOTHING_TO_SHOW, shown_layer, shown_splats
from .needs import NeedsGaussians
from .reporting import reports_errors


class CVDGS_OT_export_gaussians(NeedsGaussians, bpy.types.Operator, ExportHelper):
    """Write the Gaussians as they are shown now - layer, slider and deletions included - for other splat programs"""

    bl_idname = "cvdgs.export_gaussians"
    bl_label = "Export Gaussians"
    bl_options = {"REGISTER"}

    filename_ext = ".ply"
    check_extension = None  # the ending chooses the format

    filter_glob: bpy.props.StringProperty(default="*.ply;*.spz;*.splat", options={"HIDDEN"})
    axes: bpy.props.EnumProperty(
        name="Axes",
        description="Where the Gaussians stand in the file",
        items=(
            ("CAPTURE", "Of the Capture", "As reconstructed: fits the capture's cameras"),
            ("SCENE", "Of the Scene", "As they stand in Blender, objects' transforms included"),
        ),
    )

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        splats = shown_splats(context)
        layer, enhanced = shown_layer(splats)
        exported = read_gaussians(splats, layer, enhanced, in_scene_axes=self.axes == "SCENE")
        export_gaussians(self.filepath, exported)
        if exported.lost_view_dependence:
            self.report(
                {"WARNING"}, "Written without the parts of the colours that depend on the view: they were turned"
            )
        else:
            self.report({"INFO"}, f"{len(exported.gaussians):,} Gaussians written to {self.filepath}")
        return {"FINISHED"}


class CVDGS_OT_export_cube(NeedsGaussians, bpy.types.Operator, ExportHelper):
    """Write the layer's colour mapping as a LUT for grading and compositing programs (for display-referred sRGB)"""

    bl_idname = "cvdgs.export_cube"
    bl_label = "Export LUT"
    bl_options = {"REGISTER"}

    filename_ext = ".cube"

    filter_glob: bpy.props.StringProperty(default="*.cube", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.cvdgs.run.folder:
            cls.poll_message_set(NOTHING_TO_SHOW)
            return False
        return super().poll(context)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        layer, _ = shown_layer(shown_splats(context))
        export_cube(bpy.path.abspath(context.scene.cvdgs.run.folder), layer, self.filepath)
        self.report({"INFO"}, f"LUT of {layer} written to {self.filepath}")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (CVDGS_OT_export_gaussians, CVDGS_OT_export_cube)
