"""Operators of the sub-panel "Display"."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.compositor.apply import simulation_lifted
from ..cvdgs_addon.scene import display
from ..cvdgs_addon.scene.camera_view import has_graphics_card, leave_slow_views, view_in_color
from ..cvdgs_addon.scene.native_splats import has_native_splats, why_not_native
from ..cvdgs_addon.scene.render_settings import Display, Engine
from ..cvdgs_addon.scene.splats import show_layer
from ..cvdgs_addon.shown import shown_layer, shown_splats
from .base import NeedsGaussians, reports_errors


class CVDGS_OT_show_layer(NeedsGaussians, bpy.types.Operator):
    """Show the Gaussians in the colours of this layer"""

    bl_idname = "cvdgs.show_layer"
    bl_label = "Show Colour Layer"
    bl_options = {"REGISTER", "UNDO"}

    layer: bpy.props.StringProperty(name="Layer", description="Name of the layer, for example deutan-1.0")

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        splats = shown_splats(context)
        show_layer(splats, self.layer, shown_layer(splats)[1])
        return {"FINISHED"}


class CVDGS_OT_show_form(NeedsGaussians, bpy.types.Operator):
    """Choose what the Gaussians are drawn as"""

    bl_idname = "cvdgs.show_form"
    bl_label = "Draw Gaussians As"
    bl_options = {"REGISTER", "UNDO"}

    form: bpy.props.EnumProperty(
        name="Form",
        items=(
            ("INSTANCES", "Instances", "Every Gaussian as trained, in all engines"),
            ("POINTS", "Points", "Opaque points: fast, for placing and cropping"),
            ("NATIVE", "Native", "Blender's own splats, from Blender 5.3 on: a copy of what is shown now"),
        ),
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        text = cls.bl_rna.properties["form"].enum_items[properties.form].description
        return f"{text}. {why_not_native()}" if properties.form == "NATIVE" and not has_native_splats() else text

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        display.show_form(shown_splats(context), display.Form(self.form))
        return {"FINISHED"}


class CVDGS_OT_add_crop_box(NeedsGaussians, bpy.types.Operator):
    """Show only what is inside a box, which can be moved, turned and scaled"""

    bl_idname = "cvdgs.add_crop_box"
    bl_label = "Add Crop Box"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        splats = shown_splats(context)
        box = display.crop_box_of(splats) or display.add_crop_box(splats)
        if context.mode == "OBJECT" and box.name in context.view_layer.objects:
            for selected in context.selected_objects:
                selected.select_set(False)
            box.select_set(True)
            context.view_layer.objects.active = box
        return {"FINISHED"}


class CVDGS_OT_remove_crop_box(NeedsGaussians, bpy.types.Operator):
    """Show all Gaussians again and delete the crop box"""

    bl_idname = "cvdgs.remove_crop_box"
    bl_label = "Remove Crop Box"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        display.remove_crop_box(shown_splats(context))
        return {"FINISHED"}


class CVDGS_OT_view_in_color(NeedsGaussians, bpy.types.Operator):
    """Look through a photograph's camera, or the turntable's, in Rendered shading; Restore undoes render settings"""

    bl_idname = "cvdgs.view_in_color"
    bl_label = "View in Colour"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.area is None or context.area.type != "VIEW_3D":
            cls.poll_message_set("Needs a 3D view")
            return False
        return super().poll(context)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, chosen = context.scene, context.scene.cvdgs.display
        engine, colors = Engine[chosen.engine], Display[chosen.colors]
        with simulation_lifted(scene):
            coarse = not has_graphics_card()
            told = view_in_color(scene, context.area, shown_splats(context), engine, colors, coarse=coarse)
        self.report({"INFO"}, f"Through {scene.camera.name}" + (f"; changed: {'; '.join(told)}" if told else ""))
        return {"FINISHED"}


class CVDGS_OT_set_up_render(NeedsGaussians, bpy.types.Operator):
    """Set engine, view transform and background as Gaussians need them; what they were is remembered"""

    bl_idname = "cvdgs.set_up_render"
    bl_label = "Set Up Render"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        chosen = context.scene.cvdgs.display
        with simulation_lifted(context.scene):
            told = display.set_up_render(context.scene, Engine[chosen.engine], Display[chosen.colors])
        self.report({"INFO"}, f"Changed: {'; '.join(told)}" if told else "The settings suit Gaussians already")
        return {"FINISHED"}


class CVDGS_OT_restore_render(bpy.types.Operator):
    """Put the render settings back that were set up for Gaussians"""

    bl_idname = "cvdgs.restore_render"
    bl_label = "Restore Settings"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not any(display.render_changes(context.scene)):
            cls.poll_message_set("Nothing was set up")
            return False
        return True

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        with simulation_lifted(context.scene):
            told = display.restore_render(context.scene)
        leave_slow_views(context.scene)
        self.report({"INFO"}, f"Restored: {'; '.join(told)}" if told else "All of it was changed in the meantime")
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (
    CVDGS_OT_show_layer,
    CVDGS_OT_show_form,
    CVDGS_OT_add_crop_box,
    CVDGS_OT_remove_crop_box,
    CVDGS_OT_view_in_color,
    CVDGS_OT_set_up_render,
    CVDGS_OT_restore_render,
)
