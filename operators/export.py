"""Operators of the sub-panel "Export": splat files and LUTs for other programs."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ..core.runs.layout import ORIGINAL
from ..cvdgs_addon.export import (
    export_cube,
    export_gaussians,
    find_cube,
    proposed_cube_name,
    proposed_folder,
    proposed_name,
    read_gaussians,
)
from ..cvdgs_addon.shown import run_of, shown_layer, shown_splats
from .base import NeedsGaussians, NeedsRun, reports_errors


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
    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        _propose(self, context, proposed_name(shown_splats(context)))
        return ExportHelper.invoke(self, context, event)

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


class CVDGS_OT_export_cube(NeedsRun, bpy.types.Operator, ExportHelper):
    """Write the layer's colour mapping as a LUT for grading and compositing programs (for display-referred sRGB)"""

    bl_idname = "cvdgs.export_cube"
    bl_label = "Export LUT"
    bl_options = {"REGISTER"}

    filename_ext = ".cube"

    filter_glob: bpy.props.StringProperty(default="*.cube", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if shown_layer(shown_splats(context))[0] == ORIGINAL:
            cls.poll_message_set("The original colours need no LUT; choose a layer under Display")
            return False
        return True

    def check(self, _context: bpy.types.Context) -> bool:
        """Add the ending; ExportHelper would take the severity's decimals for one."""
        chosen = self.properties
        before = chosen.filepath
        chosen.filepath = bpy.path.ensure_ext(before, self.filename_ext)
        return chosen.filepath != before

    @reports_errors
    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        splats = shown_splats(context)
        find_cube(run_of(splats), shown_layer(splats)[0])  # refuses before it asks
        _propose(self, context, proposed_cube_name(splats))
        return ExportHelper.invoke(self, context, event)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        splats = shown_splats(context)
        layer, _ = shown_layer(splats)
        export_cube(run_of(splats), layer, self.filepath)
        self.report({"INFO"}, f"LUT of {layer} written to {self.filepath}")
        return {"FINISHED"}


def _propose(operator: bpy.types.Operator, context: bpy.types.Context, name: str) -> None:
    """Set the path to a file of this name, where the last one of its kind went, unless a script has chosen one."""
    if operator.properties.is_property_set("filepath"):
        return
    last = operator.filepath  # Blender's memory of the last call
    folder = Path(last).parent if last else proposed_folder(shown_splats(context))
    operator.filepath = str(Path(folder, name + (Path(last).suffix or operator.filename_ext)))


CLASSES: tuple[type, ...] = (CVDGS_OT_export_gaussians, CVDGS_OT_export_cube)
