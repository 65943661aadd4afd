"""Sub-panel "Viewer": whose eyes the scene is made for, and a test that suggests it."""

from __future__ import annotations

import bpy

from ..cvdgs_addon import viewer
from ..cvdgs_addon.arrangement import CAP_COUNT, NO_DIAGNOSIS
from ..cvdgs_addon.pictures import PICTURES
from .layout import SidePanel, say

_CAPS_A_ROW = 8
_CAP_SCALE = 1.4


class CVDGS_MT_viewer_presets(bpy.types.Menu):
    """Common colour vision deficiencies."""

    bl_idname = "CVDGS_MT_viewer_presets"
    bl_label = "Presets"

    def draw(self, _context: bpy.types.Context) -> None:
        for preset in viewer.PRESETS:
            text = f"{preset.label} ({preset.description})"
            self.layout.operator("cvdgs.viewer_preset", text=text).preset = preset.name


class CVDGS_PT_viewer(SidePanel, bpy.types.Panel):
    """Type and severity of the colour vision deficiency, and how much is done about it."""

    bl_idname = "CVDGS_PT_viewer"
    bl_label = "Viewer"

    def draw(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.cvdgs.viewer
        layout.menu("CVDGS_MT_viewer_presets", icon="PRESET")
        column = layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        for name in ("cvd", "severity", "simulation", "strength"):
            column.prop(properties, name)
        if properties.test_is_open:
            _draw_test(layout.box(), context)
        else:
            layout.operator("cvdgs.start_arrangement", icon="COLOR")


def _draw_test(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    scene = context.scene
    arranged, free = viewer.arranged_caps(scene), viewer.free_caps(scene)
    header = layout.row()
    header.label(text="Arrangement Test", icon="COLOR")
    header.operator("cvdgs.close_arrangement", text="", icon="X", emboss=False)
    if free:
        say(layout, context, "Which of these looks most like the last cap of the row? Click it.")
        _draw_caps(layout, free, "cvdgs.place_cap")
    layout.label(text=f"The row, {len(arranged)} of {CAP_COUNT}:")
    _draw_caps(layout, [0, *arranged], "cvdgs.take_back_cap")
    suggestion = viewer.current_suggestion(scene)
    if suggestion is not None:
        say(layout, context, suggestion.message, "INFO")
        layout.operator("cvdgs.use_suggestion", icon="CHECKMARK")
        layout.operator("cvdgs.start_arrangement", text="Again", icon="FILE_REFRESH")
    say(layout, context, NO_DIAGNOSIS)


def _draw_caps(layout: bpy.types.UILayout, caps: list[int], operator: str) -> None:
    """The caps side by side, however few they are: who compares neighbours must not see them apart."""
    rows = layout.column(align=True)
    rows.scale_x = rows.scale_y = _CAP_SCALE
    for start in range(0, len(caps), _CAPS_A_ROW):
        row = rows.row(align=True)
        row.alignment = "LEFT"
        for cap in caps[start : start + _CAPS_A_ROW]:
            icon = PICTURES.icon(viewer.cap_key(cap))
            if cap:
                row.operator(operator, text="", icon_value=icon, emboss=False).cap = cap
            else:
                row.label(text="", icon_value=icon)


CLASSES: tuple[type, ...] = (CVDGS_MT_viewer_presets, CVDGS_PT_viewer)
