"""Operators of the sub-panels "Viewer" and "Simulate": presets, the arrangement test, and what the viewer sees."""

from __future__ import annotations

import bpy

from ..cvdgs_addon import comparison, viewer
from ..cvdgs_addon.compositor.simulation_group import library_folder, save_asset
from .base import Action, NeedsGaussians

_PRESET_ITEMS = tuple((preset.name, preset.label, preset.description) for preset in viewer.PRESETS)


class CVDGS_OT_viewer_preset(Action, bpy.types.Operator):
    """Set the type and severity of a common colour vision deficiency"""

    bl_idname = "cvdgs.viewer_preset"
    bl_label = "Viewer Preset"

    preset: bpy.props.EnumProperty(name="Preset", description="The deficiency", items=_PRESET_ITEMS)

    def act(self, context: bpy.types.Context) -> None:
        viewer.apply_preset(context.scene, self.preset)


class CVDGS_OT_start_arrangement(Action, bpy.types.Operator):
    """Order fifteen coloured caps by similarity to get a suggested type and severity. Not a diagnosis"""

    bl_idname = "cvdgs.start_arrangement"
    bl_label = "Arrangement Test"

    seed: bpy.props.IntProperty(
        name="Seed", description="Random seed for the order of the caps; 0: a new order every time", min=0
    )

    def act(self, context: bpy.types.Context) -> None:
        viewer.start_test(context.scene, self.seed)


class _DuringTest(Action):
    """An operator of the arrangement test while that is open."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        return "" if context.scene.cvdgs.viewer.test_is_open else "Start the arrangement test first"


class _OfCap(_DuringTest):
    """What is done with one cap."""

    cap: bpy.props.IntProperty(name="Cap", description="Number of the cap", min=1, max=viewer.CAP_COUNT)


class CVDGS_OT_place_cap(_OfCap, bpy.types.Operator):
    """Place this cap at the end of the row; choose the one most similar to the last"""

    bl_idname = "cvdgs.place_cap"
    bl_label = "Place Cap"

    def act(self, context: bpy.types.Context) -> None:
        viewer.place_cap(context.scene, self.cap)


class CVDGS_OT_take_back_cap(_OfCap, bpy.types.Operator):
    """Take this cap back out of the row"""

    bl_idname = "cvdgs.take_back_cap"
    bl_label = "Take Back Cap"

    def act(self, context: bpy.types.Context) -> None:
        viewer.take_back_cap(context.scene, self.cap)


class CVDGS_OT_use_suggestion(_DuringTest, bpy.types.Operator):
    """Use the type and severity that the arrangement suggests, and close the test"""

    bl_idname = "cvdgs.use_suggestion"
    bl_label = "Use Suggestion"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        suggestion = viewer.current_suggestion(context.scene)
        has_type = suggestion is not None and suggestion.cvd is not None
        return super().missing(context) or ("" if has_type else "This order suggests no type")

    def act(self, context: bpy.types.Context) -> None:
        viewer.use_suggestion(context.scene)


class CVDGS_OT_close_arrangement(_DuringTest, bpy.types.Operator):
    """Close the test and keep the current settings"""

    bl_idname = "cvdgs.close_arrangement"
    bl_label = "Close Test"

    def act(self, context: bpy.types.Context) -> None:
        context.scene.cvdgs.viewer.test_is_open = False


class CVDGS_OT_simulate(Action, bpy.types.Operator):
    """Turn the colour vision deficiency simulation on or off, in renders and in 3D views"""

    bl_idname = "cvdgs.simulate"
    bl_label = "Simulate CVD"

    def act(self, context: bpy.types.Context) -> None:
        simulate = context.scene.cvdgs.simulate
        on = not (simulate.in_renders and simulate.in_viewport)
        simulate.in_renders = simulate.in_viewport = on


class CVDGS_OT_compare(NeedsGaussians, bpy.types.Operator):
    """Show original and enhanced colours side by side, both as the viewer sees them, or no longer"""

    bl_idname = "cvdgs.compare"
    bl_label = "Compare Original and Enhanced"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        nothing = "" if comparison.has_comparison(context.scene) else comparison.NOTHING_TO_COMPARE
        return super().missing(context) or nothing

    def act(self, context: bpy.types.Context) -> None:
        on = not comparison.is_compared(context.scene)
        comparison.compare(context.scene, on=on)
        if on:
            self.report({"INFO"}, "Left original, right enhanced; see View in Colour, or render")


class CVDGS_OT_save_simulation_asset(Action, bpy.types.Operator):
    """Save the compositor node group "CVD simulation" to an asset library, for use without this add-on"""

    bl_idname = "cvdgs.save_simulation_asset"
    bl_label = "Save Node as Asset"
    bl_options = {"REGISTER"}

    directory: bpy.props.StringProperty(
        name="Asset Library", description="Folder of the asset library", subtype="DIR_PATH"
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.directory = self.directory or library_folder()
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, _context: bpy.types.Context) -> None:
        path = save_asset(bpy.path.abspath(self.directory or library_folder()))
        self.report({"INFO"}, f"Saved {path}")


CLASSES: tuple[type, ...] = (
    CVDGS_OT_viewer_preset,
    CVDGS_OT_start_arrangement,
    CVDGS_OT_place_cap,
    CVDGS_OT_take_back_cap,
    CVDGS_OT_use_suggestion,
    CVDGS_OT_close_arrangement,
    CVDGS_OT_simulate,
    CVDGS_OT_compare,
    CVDGS_OT_save_simulation_asset,
)
