"""Sub-panel "Turntable": the camera's way around the Gaussians, and its pictures."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.scene.turntable import rendering_changes, turntable_of
from ..cvdgs_addon.shown import NOTHING_TO_SHOW, shown_splats
from .display import say_bystanders, say_unsuitable_view
from .layout import SidePanel, say, say_missing

# Properties of the way around, with the panel's words where 0 lets the photographs decide.
_WAY = {
    "frames": None,
    "radius": "Radius (0: auto)",
    "height": None,
    "focal_length": "Focal Length (0: auto)",
    "arc": "Arc (0: auto)",
}


class CVDGS_PT_turntable(SidePanel, bpy.types.Panel):
    """Pictures from all around."""

    bl_idname = "CVDGS_PT_turntable"
    bl_label = "Turntable"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, chosen = self.layout, context.scene.cvdgs.turntable
        if shown_splats(context) is None:
            say_missing(layout, context, NOTHING_TO_SHOW)
            return
        column = layout.column(align=True)
        for name, text in _WAY.items():
            column.prop(chosen, name, text=text)
        has_rig = turntable_of(context.scene) is not None
        row = layout.row(align=True)
        row.operator("cvdgs.add_turntable", text="Update Turntable" if has_rig else None, icon="CON_FOLLOWPATH")
        if has_rig:
            row.operator("cvdgs.remove_turntable", text="", icon="X")
        row = layout.row(align=True)
        row.prop(chosen, "width")
        row.prop(chosen, "height_pixels")
        column = layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.prop(chosen, "engine")
        column.prop(chosen, "folder")
        layout.operator("cvdgs.render_turntable", icon="RENDER_ANIMATION")
        if any(rendering_changes(context.scene)):
            say(layout, context, "Rendering; the scene's own settings come back when it ends", "TIME")
            return
        say_unsuitable_view(layout, context)
        say_bystanders(layout, context, "The pictures also show")


CLASSES: tuple[type, ...] = (CVDGS_PT_turntable,)
