"""Operators of the sub-panel "Simulate"."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.compositor.simulation_group import library_folder, save_asset
from .base import reports_errors


class CVDGS_OT_simulate(bpy.types.Operator):
    """Show renders and 3D views as they are seen with the colour vision deficiency, or as they are again"""

    bl_idname = "cvdgs.simulate"
    bl_label = "Simulate CVD"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        simulate = context.scene.cvdgs.simulate
        on = not (simulate.in_renders and simulate.in_viewport)
        simulate.in_renders = simulate.in_viewport = on
        return {"FINISHED"}


class CVDGS_OT_save_simulation_asset(bpy.types.Operator):
    """Save the compositor node group "CVD simulation" into an asset library, for files without this add-on"""

    bl_idname = "cvdgs.save_simulation_asset"
    bl_label = "Save Node as Asset"
    bl_options = {"REGISTER"}

    directory: bpy.props.StringProperty(name="Asset Library", description="Folder of the library", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.directory = self.directory or library_folder()
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @reports_errors
    def execute(self, _context: bpy.types.Context) -> set[str]:
        path = save_asset(bpy.path.abspath(self.directory or library_folder()))
        self.report({"INFO"}, f"Saved {path}")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (CVDGS_OT_simulate, CVDGS_OT_save_simulation_asset)
