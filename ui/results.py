"""Sub-panels "Report" and "Export": the figures of the Gaussians' run, and files for other programs."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.results import figures_of, read_report
from ..cvdgs_addon.scene.origin import run_of
from ..cvdgs_addon.shown import RUN_UNKNOWN, shown_layer
from .layout import GaussiansPanel, say

_LONGEST_NAME = 34  # characters beside a value; longer ones are wrapped


class CVDGS_PT_report(GaussiansPanel, bpy.types.Panel):
    """Quality figures of the run."""

    bl_idname = "CVDGS_PT_report"
    bl_label = "Report"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_for(self, context: bpy.types.Context, splats: bpy.types.Object) -> None:
        layout = self.layout
        folder = run_of(splats)
        if not folder:
            say(layout, context, RUN_UNKNOWN, "INFO")
            return
        report = read_report(folder)
        if not report:
            say(layout, context, f"There is no report in {folder} - load the run again from its current folder", "INFO")
            return
        for heading, rows in figures_of(report).items():
            box = layout.box()
            box.label(text=heading)
            column = box.column(align=True)
            for name, value in rows:
                if len(name) > _LONGEST_NAME:
                    say(column, context, f"{name}: {value}")
                    continue
                split = column.split(factor=0.72)
                split.label(text=name)
                right = split.row()
                right.alignment = "RIGHT"
                right.label(text=value)
        layout.operator("cvdgs.open_report", icon="URL")


class CVDGS_PT_export(GaussiansPanel, bpy.types.Panel):
    """Splat files, a web page, glTF, USD and the colour mapping, for other programs."""

    bl_idname = "CVDGS_PT_export"
    bl_label = "Export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_for(self, context: bpy.types.Context, splats: bpy.types.Object) -> None:
        layout = self.layout
        layer, enhanced = shown_layer(splats)
        say(layout, context, f"{splats.name} - Colours: {layer}, {enhanced:.0%}", "OUTLINER_OB_POINTCLOUD")
        column = layout.column(align=True)
        column.operator_context = "INVOKE_DEFAULT"
        column.operator("cvdgs.export_gaussians", text="Gaussians (.ply, .spz, .splat)", icon="EXPORT")
        column.operator("cvdgs.export_web_page", text="Web Page (.html)", icon="WORLD")
        column.operator("cvdgs.export_layers", text="All Layers (.glb, .usd)", icon="FILE_3D")
        column.operator("cvdgs.export_cube", text="Colour Mapping (.cube)", icon="COLOR")


CLASSES: tuple[type, ...] = (CVDGS_PT_report, CVDGS_PT_export)
