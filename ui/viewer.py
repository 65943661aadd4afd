"""Sub-panels "Viewer" and "Simulate": whose eyes the scene is made for, a test that suggests it, and what they see."""

from __future__ import annotations

import bpy

from ..core.color.arrangement import CAP_COUNT, NO_DIAGNOSIS
from ..cvdgs_addon import viewer
from ..cvdgs_addon.comparison import is_compared
from ..cvdgs_addon.compositor.apply import renders_can_go_without, simulation_node, told_changes
from ..cvdgs_addon.compositor.display_nodes import what_is_left_out
from ..cvdgs_addon.pictures import PICTURES
from .layout import SidePanel, draw_changes, say, split_column

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
    """Type and severity of the colour vision deficiency, and strength of the enhancement."""

    bl_idname = "CVDGS_PT_viewer"
    bl_label = "Viewer"

    def draw(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.cvdgs.viewer
        layout.menu("CVDGS_MT_viewer_presets", icon="PRESET")
        column = split_column(layout)
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
        say(layout, context, "Click the cap that looks most similar to the last one in the row.")
        _draw_caps(layout, free, "cvdgs.place_cap")
    layout.label(text=f"Row: {len(arranged)} of {CAP_COUNT}")
    _draw_caps(layout, [0, *arranged], "cvdgs.take_back_cap")
    suggestion = viewer.current_suggestion(scene)
    if suggestion is not None:
        say(layout, context, suggestion.message, "INFO")
        layout.operator("cvdgs.use_suggestion", icon="CHECKMARK")
        layout.operator("cvdgs.start_arrangement", text="Start Again", icon="FILE_REFRESH")
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


class CVDGS_PT_simulate(SidePanel, bpy.types.Panel):
    """Renders and 3D views as seen with a colour vision deficiency."""

    bl_idname = "CVDGS_PT_simulate"
    bl_label = "Simulate"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        simulate = scene.cvdgs.simulate
        row = layout.row(align=True)
        row.prop(simulate, "in_renders", toggle=True)
        row.prop(simulate, "in_viewport", toggle=True)
        if simulate.in_viewport and not simulate.in_renders and not renders_can_go_without(scene):
            say(
                layout,
                context,
                "Renders show the simulation too, because they need the compositor for other nodes",
                "INFO",
            )
        layout.operator("cvdgs.compare", icon="ARROW_LEFTRIGHT", depress=is_compared(scene))
        layout.prop(simulate, "same_as_viewer")
        chosen = scene.cvdgs.viewer if simulate.same_as_viewer else simulate
        column = split_column(layout)
        column.enabled = not simulate.same_as_viewer
        for name in ("cvd", "severity", "simulation"):
            column.prop(chosen, name)
        if (chosen.cvd, chosen.simulation) == ("tritan", "vienot"):
            say(layout, context, "Viénot's model has no tritan; Brettel's is used", "INFO")
        column = layout.column(align=True)
        row = column.row(align=True)
        row.prop(simulate, "wipe", toggle=True)
        row.prop(simulate, "compare", toggle=True)
        row = column.row(align=True)
        row.enabled = simulate.wipe or simulate.compare
        row.prop(simulate, "wipe_position")
        _draw_simulation_notes(layout, context)
        layout.operator("cvdgs.save_simulation_asset", icon="ASSET_MANAGER")


def _draw_simulation_notes(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What the simulation has changed, or what it will leave out."""
    if simulation_node(context.scene) is None:
        missing = what_is_left_out(context.scene)
        if missing:
            say(layout, context, f"The simulation will leave out: {missing}", "ERROR")
        return
    draw_changes(layout, context, "cvdgs_simulation_changes", list(told_changes(context.scene)))
