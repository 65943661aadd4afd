"""Sub-panel "Simulate": the picture as it is seen with a colour vision deficiency."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.compositor.apply import renders_can_go_without, simulation_node, told_changes
from ..cvdgs_addon.compositor.display_nodes import what_is_left_out
from .layout import SidePanel, draw_changes, say


class CVDGS_PT_simulate(SidePanel, bpy.types.Panel):
    """Renders and 3D views as they are seen with a colour vision deficiency."""

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
            say(layout, context, "Renders show it too: they need the compositor for more than this", "INFO")
        layout.prop(simulate, "same_as_viewer")
        chosen = scene.cvdgs.viewer if simulate.same_as_viewer else simulate
        column = layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.enabled = not simulate.same_as_viewer
        for name in ("cvd", "severity", "simulation"):
            column.prop(chosen, name)
        if (chosen.cvd, chosen.simulation) == ("tritan", "vienot"):
            say(layout, context, "Viénot describes no tritan vision; Brettel's model is shown", "INFO")
        row = layout.row(align=True)
        row.prop(simulate, "wipe", toggle=True)
        sub = row.row(align=True)
        sub.enabled = simulate.wipe
        sub.prop(simulate, "wipe_position", text="")
        _draw_notes(layout, context)
        layout.operator("cvdgs.save_simulation_asset", icon="ASSET_MANAGER")


def _draw_notes(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What the simulation has changed, or what it will leave out."""
    if simulation_node(context.scene) is None:
        missing = what_is_left_out(context.scene)
        if missing:
            say(layout, context, f"The simulation leaves out: {missing}", "ERROR")
        return
    draw_changes(layout, context, "cvdgs_simulation_changes", list(told_changes(context.scene)))


CLASSES: tuple[type, ...] = (CVDGS_PT_simulate,)
