"""Operators of the part "Select and Clean Up" of the sub-panel "Display"."""

from __future__ import annotations

import math

import bpy

from ..cvdgs_addon.scene import masks
from ..cvdgs_addon.scene.masks import Treatment, object_mode
from ..cvdgs_addon.scene.recolor import Change, recolor, source_layer
from ..cvdgs_addon.scene.splats import show_layer
from ..cvdgs_addon.shown import show_source_of_missing_layer, shown_layer, shown_splats
from .base import ChangesGaussians

_DONE = {
    Treatment.REMOVE: "Removed {} Gaussians",
    Treatment.KEEP_ORIGINAL: "Kept original colours of {} Gaussians",
    Treatment.RESTORE: "Restored layer colours of {} Gaussians",
}
NOTHING_MASKED = "Nothing is removed, recoloured or kept in its original colours"


class CVDGS_OT_edit_points(ChangesGaussians, bpy.types.Operator):
    """Choose Gaussians with Blender's own tools: in Edit Mode, B draws a box and C paints a circle"""

    bl_idname = "cvdgs.edit_points"
    bl_label = "Select by Hand"

    def act(self, context: bpy.types.Context) -> None:
        masks.edit_points(shown_splats(context))


class _Selects(ChangesGaussians):
    """An operator that selects Gaussians, for Edit Mode."""

    extend: bpy.props.BoolProperty(name="Extend", description="Keep what is selected already")

    def chosen(self, splats: bpy.types.Object) -> masks.Mask:
        """(V,) the points to select. Each operator its own."""
        raise AssertionError

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        with object_mode(splats, end_in_edit_mode=True):
            count = masks.select(splats, self.chosen(splats), extend=self.extend)
        self.report({"INFO"}, f"{count:,} Gaussians selected")  # type: ignore[attr-defined]


class CVDGS_OT_select_color(_Selects, bpy.types.Operator):
    """Select Gaussians by their original colour"""

    bl_idname = "cvdgs.select_color"
    bl_label = "Select by Colour"

    color: bpy.props.FloatVectorProperty(
        name="Colour", description="As photographed", subtype="COLOR_GAMMA", min=0.0, max=1.0, default=(0.5, 0.5, 0.5)
    )
    tolerance: bpy.props.FloatProperty(
        name="Tolerance", description="Largest difference of a channel", subtype="FACTOR", min=0.0, max=1.0, default=0.1
    )

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self)

    def chosen(self, splats: bpy.types.Object) -> masks.Mask:
        return masks.by_color(splats, self.color, self.tolerance)


class CVDGS_OT_select_floaters(_Selects, bpy.types.Operator):
    """Select what is likely no part of the scene, by the scores of a run that has them"""

    bl_idname = "cvdgs.select_floaters"
    bl_label = "Select Floaters"

    least: bpy.props.FloatProperty(
        name="Score", description="The least score to select", subtype="FACTOR", min=0.0, max=1.0, default=0.5
    )

    def chosen(self, splats: bpy.types.Object) -> masks.Mask:
        return masks.by_floater_score(splats, self.least)


class CVDGS_OT_select_box(_Selects, bpy.types.Operator):
    """Select Gaussians inside the crop box, whether or not it crops"""

    bl_idname = "cvdgs.select_box"
    bl_label = "Select in Crop Box"

    def chosen(self, splats: bpy.types.Object) -> masks.Mask:
        return masks.by_box(splats)


class CVDGS_OT_treat_selected(ChangesGaussians, bpy.types.Operator):
    """Treat the selected Gaussians"""

    bl_idname = "cvdgs.treat_selected"
    bl_label = "Treat Selected Gaussians"

    treatment: bpy.props.EnumProperty(
        name="Treatment",
        items=(
            ("REMOVE", "Remove", "Neither draw nor export the selected Gaussians; Take All Back brings them back"),
            ("KEEP_ORIGINAL", "Keep Original Colours", "Show the selected Gaussians as photographed, in every layer"),
            ("RESTORE", "Use Layer's Colours", "Show the selected Gaussians in the layer's colours again"),
        ),
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return cls.bl_rna.properties["treatment"].enum_items[properties.treatment].description

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        treatment = Treatment(self.treatment)
        with object_mode(splats):
            count = masks.treat_selected(splats, treatment)
        self.report({"INFO"}, _DONE[treatment].format(f"{count:,}"))


class CVDGS_OT_recolor_selected(ChangesGaussians, bpy.types.Operator):
    """Change the colours of the selected Gaussians in a layer of its own, beside the one that is shown"""

    bl_idname = "cvdgs.recolor_selected"
    bl_label = "Recolour Selected"

    hue: bpy.props.FloatProperty(
        name="Hue", description="Turn of the hue", subtype="ANGLE", min=-math.pi, max=math.pi, options={"SKIP_SAVE"}
    )
    saturation: bpy.props.FloatProperty(
        name="Saturation", description="Factor", min=0.0, max=4.0, default=1.0, options={"SKIP_SAVE"}
    )
    value: bpy.props.FloatProperty(
        name="Value", description="Factor of the brightness", min=0.0, max=4.0, default=1.0, options={"SKIP_SAVE"}
    )

    def on_click(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """A popup that shows every change at once."""
        return context.window_manager.invoke_props_popup(self, event)

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        show_source_of_missing_layer(splats)
        layer, enhanced = shown_layer(splats)
        with object_mode(splats):
            change = Change(self.hue / (2.0 * math.pi), self.saturation, self.value)
            name = recolor(splats, masks.selected(splats), layer, change)
        show_layer(splats, name, enhanced or 1.0)
        self.report({"INFO"}, f"Recoloured in the layer {name}")


class CVDGS_OT_remove_floaters(ChangesGaussians, bpy.types.Operator):
    """Remove what is likely no part of the scene, by the scores of its run; Take All Back brings it back"""

    bl_idname = "cvdgs.remove_floaters"
    bl_label = "Remove Floaters"

    amount: bpy.props.FloatProperty(
        name="Amount",
        description="0: none, 0.5: the clear cases, 1: every suspicion",
        subtype="FACTOR",
        min=0.0,
        max=1.0,
        default=0.5,
    )

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        with object_mode(splats):
            count = masks.remove_floaters(splats, self.amount)
        self.report({"INFO"}, f"{count:,} Gaussians removed; move the slider under Adjust Last Operation")


class CVDGS_OT_take_all_back(ChangesGaussians, bpy.types.Operator):
    """Show all Gaussians again, in the layer's colours; those that were deleted in Edit Mode stay away"""

    bl_idname = "cvdgs.take_all_back"
    bl_label = "Take All Back"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        reason = super().missing(context)
        return reason or ("" if masks.has_masks(shown_splats(context)) else NOTHING_MASKED)

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        with object_mode(splats):
            masks.take_all_back(splats)
        layer, enhanced = shown_layer(splats)
        show_layer(splats, source_layer(layer), enhanced)


CLASSES: tuple[type, ...] = (
    CVDGS_OT_edit_points,
    CVDGS_OT_select_color,
    CVDGS_OT_select_floaters,
    CVDGS_OT_select_box,
    CVDGS_OT_treat_selected,
    CVDGS_OT_recolor_selected,
    CVDGS_OT_remove_floaters,
    CVDGS_OT_take_all_back,
)
