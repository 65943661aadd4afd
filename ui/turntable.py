"""Sub-panel "Turntable": the camera's path around the Gaussians, and its images."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.scene.turntable import rendering_changes, turntable_of
from .display import say_bystanders, say_unsuitable_view
from .layout import GaussiansPanel, say, split_column

# Properties of the camera's path, with the panel's words where 0 lets the photographs decide.
_PATH = {
    "frames": None,
    "radius": "Radius (0: auto)",
    "height": None,
    "focal_length": "Focal Length (0: auto)",
    "arc": "Arc (0: auto)",
}


class CVDGS_PT_turntable(GaussiansPanel, bpy.types.Panel):
    """Images from all around."""

    bl_idname = "CVDGS_PT_turntable"
    bl_label = "Turntable"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_for(self, context: bpy.types.Context, _splats: bpy.types.Object) -> None:
        layout, chosen = self.layout, context.scene.cvdgs.turntable
        column = layout.column(align=True)
        for name, text in _PATH.items():
            row = column.row(align=True)
            if name == "height":  # 0 is a height like any other, so a box decides
                row.prop(chosen, "has_height", text="" if chosen.has_height else None)
            if name != "height" or chosen.has_height:
                row.prop(chosen, name, text=text)
        has_rig = turntable_of(context.scene) is not None
        row = layout.row(align=True)
        row.operator("cvdgs.add_turntable", text="Update Turntable" if has_rig else None, icon="CON_FOLLOWPATH")
        if has_rig:
            row.operator("cvdgs.remove_turntable", text="", icon="X")
        row = layout.row(align=True)
        row.prop(chosen, "width")
        row.prop(chosen, "height_pixels")
        column = split_column(layout)
        column.prop(chosen, "engine")
        column.prop(chosen, "folder")
        layout.operator("cvdgs.render_turntable", icon="RENDER_ANIMATION")
        if any(rendering_changes(context.scene)):
            say(layout, context, "Rendering; the scene's settings will be restored afterwards", "TIME")
            return
        say_unsuitable_view(layout, context)
        say_bystanders(layout, context, "The images also show")
