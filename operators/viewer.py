"""Operators of the sub-panel "Viewer": presets, and the arrangement test."""

from __future__ import annotations

import bpy

from ..cvdgs_addon import viewer
from .base import reports_errors

_PRESET_ITEMS = tuple((preset.name, preset.label, preset.description) for preset in viewer.PRESETS)


class CVDGS_OT_viewer_preset(bpy.types.Operator):
    """Set type and severity of a common colour vision deficiency"""

    bl_idname = "cvdgs.viewer_preset"
    bl_label = "Viewer Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(name="Preset", description="The deficiency", items=_PRESET_ITEMS)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        viewer.apply_preset(context.scene, self.preset)
        return {"FINISHED"}


class CVDGS_OT_start_arrangement(bpy.types.Operator):
    """Arrange fifteen coloured caps so that neighbours look most alike; suggests type and severity, is no diagnosis"""

    bl_idname = "cvdgs.start_arrangement"
    bl_label = "Arrangement Test"
    bl_options = {"REGISTER", "UNDO"}

    seed: bpy.props.IntProperty(
        name="Seed", description="Of the order in which the caps are offered; 0: another every time", min=0
    )

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        viewer.start_test(context.scene, self.seed)
        return {"FINISHED"}


class _DuringTest:
    """What needs the arrangement test to be open."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.cvdgs.viewer.test_is_open:
            cls.poll_message_set("Start the arrangement test first")  # type: ignore[attr-defined]
            return False
        return True


class _OfCap(_DuringTest):
    """What is done with one cap."""

    cap: bpy.props.IntProperty(name="Cap", description="Number of the cap", min=1, max=viewer.CAP_COUNT)


class CVDGS_OT_place_cap(_OfCap, bpy.types.Operator):
    """Put this cap at the end of the row: the one that looks most like the last"""

    bl_idname = "cvdgs.place_cap"
    bl_label = "Place Cap"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        viewer.place_cap(context.scene, self.cap)
        return {"FINISHED"}


class CVDGS_OT_take_back_cap(_OfCap, bpy.types.Operator):
    """Take this cap out of the row again, or exchange it"""

    bl_idname = "cvdgs.take_back_cap"
    bl_label = "Take Back Cap"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        viewer.take_back_cap(context.scene, self.cap)
        return {"FINISHED"}


class CVDGS_OT_use_suggestion(_DuringTest, bpy.types.Operator):
    """Take over the type and severity that the arrangement suggests, and close the test"""

    bl_idname = "cvdgs.use_suggestion"
    bl_label = "Use Suggestion"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        suggestion = viewer.current_suggestion(context.scene)
        if suggestion is None or suggestion.cvd is None:
            cls.poll_message_set("The arrangement suggests nothing")
            return False
        return True

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        viewer.use_suggestion(context.scene)
        return {"FINISHED"}


class CVDGS_OT_close_arrangement(_DuringTest, bpy.types.Operator):
    """Close the test and leave the settings as they are"""

    bl_idname = "cvdgs.close_arrangement"
    bl_label = "Close Test"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.cvdgs.viewer.test_is_open = False
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (
    CVDGS_OT_viewer_preset,
    CVDGS_OT_start_arrangement,
    CVDGS_OT_place_cap,
    CVDGS_OT_take_back_cap,
    CVDGS_OT_use_suggestion,
    CVDGS_OT_close_arrangement,
)
