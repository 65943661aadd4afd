"""Sub-panel "Export": files for other programs."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.shown import NOTHING_TO_SHOW, shown_layer, shown_splats
from .layout import SidePanel, say, say_missing


class CVDGS_PT_export(SidePanel, bpy.types.Panel):
    """Splat files and LUTs."""

    bl_idname = "CVDGS_PT_export"
    bl_label = "Export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, splats = self.layout, shown_splats(context)
        if splats is None:
            say_missing(layout, context, NOTHING_TO_SHOW)
            return
        layer, enhanced = shown_layer(splats)
        say(layout, context, f"{splats.name}: {layer}, {enhanced:.0%}", "OUTLINER_OB_POINTCLOUD")
        column = layout.column(align=True)
        column.operator_context = "INVOKE_DEFAULT"
        column.operator("cvdgs.export_gaussians", text="Gaussians (.ply, .spz, .splat)", icon="EXPORT")
        column.operator("cvdgs.export_cube", text="Colour Mapping (.cube)", icon="COLOR")


CLASSES: tuple[type, ...] = (CVDGS_PT_export,)
