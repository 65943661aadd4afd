"""Operators of the sub-panel "Display"."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.compositor.apply import simulation_lifted
from ..cvdgs_addon.scene import crop, display, neighbours, preview
from ..cvdgs_addon.scene.apart import follow, is_apart
from ..cvdgs_addon.scene.bystanders import bystanders, hide
from ..cvdgs_addon.scene.camera_view import has_graphics_card, leave_slow_views, view_in_color
from ..cvdgs_addon.scene.catcher import add_catcher
from ..cvdgs_addon.scene.estimated_light import add_estimated_light
from ..cvdgs_addon.scene.native_splats import has_native_splats, why_not_native
from ..cvdgs_addon.scene.render_settings import Display, Engine
from ..cvdgs_addon.scene.splats import show_layer
from ..cvdgs_addon.shown import shown_layer, shown_splats
from .base import Action, ChangesGaussians, NeedsGaussians


class CVDGS_OT_show_layer(NeedsGaussians, bpy.types.Operator):
    """Show the Gaussians in the colours of this layer"""

    bl_idname = "cvdgs.show_layer"
    bl_label = "Show Colour Layer"

    layer: bpy.props.StringProperty(name="Layer", description="Name of the layer, for example deutan-1.0")

    def act(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        show_layer(splats, self.layer, shown_layer(splats)[1])


class CVDGS_OT_show_form(NeedsGaussians, bpy.types.Operator):
    """Choose what the Gaussians are drawn as"""

    bl_idname = "cvdgs.show_form"
    bl_label = "Draw Gaussians As"

    form: bpy.props.EnumProperty(
        name="Form",
        items=(
            (
                "PREVIEW",
                "Preview",
                "Coloured quads in the 3D view, for Solid shading and orbiting; renders are as trained",
            ),
            ("INSTANCES", "Instances", "Every Gaussian as trained, in every engine"),
            ("POINTS", "Points", "Opaque points: fast, for positioning and cropping"),
            ("NATIVE", "Native", "A copy of what is shown now as Blender's own splats (Blender 5.3 and later)"),
        ),
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        text = cls.bl_rna.properties["form"].enum_items[properties.form].description
        return f"{text}. {why_not_native()}" if properties.form == "NATIVE" and not has_native_splats() else text

    def act(self, context: bpy.types.Context) -> None:
        form = display.Form(self.form)
        display.show_form(shown_splats(context), form)
        context.scene.cvdgs.display.automatic = form is display.Form.PREVIEW  # what was chosen stays
        if form is display.Form.PREVIEW and context.space_data is not None and context.space_data.type == "VIEW_3D":
            preview.shade_flat(context.space_data)


class CVDGS_OT_add_crop_box(ChangesGaussians, bpy.types.Operator):
    """Show only what is inside a box that can be moved, rotated and scaled"""

    bl_idname = "cvdgs.add_crop_box"
    bl_label = "Add Crop Box"

    def act(self, context: bpy.types.Context) -> None:
        box = crop.usable_crop_box(shown_splats(context))
        if context.mode == "OBJECT" and box.name in context.view_layer.objects:
            for selected in context.selected_objects:
                selected.select_set(False)
            box.select_set(True)
            context.view_layer.objects.active = box


class CVDGS_OT_remove_crop_box(ChangesGaussians, bpy.types.Operator):
    """Delete the crop box and show all Gaussians again"""

    bl_idname = "cvdgs.remove_crop_box"
    bl_label = "Remove Crop Box"

    def act(self, context: bpy.types.Context) -> None:
        crop.remove_crop_box(shown_splats(context))


class _InView(NeedsGaussians):
    """An operator on the 3D view that it is called in."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        is_view = context.area is not None and context.area.type == "VIEW_3D"
        return super().missing(context) if is_view else "Only available in a 3D view"


class CVDGS_OT_view_in_color(_InView, bpy.types.Operator):
    """Look through a camera of the capture or the turntable in Rendered shading; Restore puts the settings back"""

    bl_idname = "cvdgs.view_in_color"
    bl_label = "View in Colour"

    def act(self, context: bpy.types.Context) -> None:
        scene, chosen = context.scene, context.scene.cvdgs.display
        engine, colors = Engine[chosen.engine], Display[chosen.colors]
        with simulation_lifted(scene):
            coarse = not has_graphics_card()
            told = view_in_color(scene, context.area, engine, colors, coarse=coarse)
        preview.end_looking_around(scene)
        if display.form_of(shown_splats(context)) is display.Form.PREVIEW:
            display.show_form(shown_splats(context), display.Form.INSTANCES)
        self.report(
            {"INFO"}, f"Looking through {scene.camera.name}" + (f"; changed: {'; '.join(told)}" if told else "")
        )


class CVDGS_OT_draw_faster(Action, bpy.types.Operator):
    """Turn off Preferences > Viewport > Anti-Aliasing, which takes a third of each redraw without a graphics card"""

    bl_idname = "cvdgs.draw_faster"
    bl_label = "Turn Off Anti-Aliasing"
    bl_options = {"REGISTER"}

    def act(self, context: bpy.types.Context) -> None:
        context.preferences.system.viewport_aa = "OFF"
        remedy = "Preferences > Viewport > Anti-Aliasing turns smooth edges back on"
        self.report({"INFO"}, f"3D views are drawn faster; {remedy}")


class CVDGS_OT_look_around(_InView, bpy.types.Operator):
    """Material Preview from any side. Without a graphics card: the most important Gaussians, seconds per redraw"""

    bl_idname = "cvdgs.look_around"
    bl_label = "Look Around in Colour"

    def act(self, context: bpy.types.Context) -> None:
        preview.look_around(context.scene, context.space_data)


class CVDGS_OT_add_light(NeedsGaussians, bpy.types.Operator):
    """Add lamps that shine on your objects like the light in which the scene was photographed: a guess, from colours"""

    bl_idname = "cvdgs.add_light"
    bl_label = "Light of the Photographs"

    def act(self, context: bpy.types.Context) -> None:
        lamps = add_estimated_light(shown_splats(context), context.scene)
        self.report({"INFO"}, f"Added {', '.join(lamp.name for lamp in lamps)}")


class CVDGS_OT_add_catcher(NeedsGaussians, bpy.types.Operator):
    """Add a floor that shows nothing but the shadows of your objects on the Gaussians, in renders"""

    bl_idname = "cvdgs.add_catcher"
    bl_label = "Shadow Catcher"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        reason = "" if is_apart(context.scene) else "Choose Cycles, With Lamps, and Set Up Render first"
        return super().missing(context) or reason

    def act(self, context: bpy.types.Context) -> None:
        scene = context.scene
        standing = [scene.objects[name] for name in bystanders(scene)]
        add_catcher(scene, shown_splats(context), standing)
        follow(scene)


class CVDGS_OT_hide_bystanders(NeedsGaussians, bpy.types.Operator):
    """Hide what renders show beside Gaussians; Object > Show/Hide > Show Hidden Objects brings it back to the view"""

    bl_idname = "cvdgs.hide_bystanders"
    bl_label = "Hide Other Objects"

    def act(self, context: bpy.types.Context) -> None:
        names = bystanders(context.scene)
        hide(context.scene, names)
        self.report({"INFO"}, f"Hidden: {', '.join(names)}" if names else "Nothing to hide")


class CVDGS_OT_hide_other_gaussians(NeedsGaussians, bpy.types.Operator):
    """Hide the Gaussians of all other runs; Object > Show/Hide > Show Hidden Objects brings them back to the view"""

    bl_idname = "cvdgs.hide_other_gaussians"
    bl_label = "Hide Other Gaussians"

    def act(self, context: bpy.types.Context) -> None:
        names = neighbours.hide_others(context.scene, shown_splats(context))
        self.report({"INFO"}, f"Hidden: {', '.join(names)}" if names else "Nothing to hide")


class CVDGS_OT_place_beside(NeedsGaussians, bpy.types.Operator):
    """Move these Gaussians, with their cameras, beside all others; a duplicate moves alone"""

    bl_idname = "cvdgs.place_beside"
    bl_label = "Place Beside"

    def act(self, context: bpy.types.Context) -> None:
        neighbours.place_beside(context.scene, shown_splats(context))


class CVDGS_OT_set_up_render(NeedsGaussians, bpy.types.Operator):
    """Set engine, view transform and background to what Gaussians need; Restore puts the old settings back"""

    bl_idname = "cvdgs.set_up_render"
    bl_label = "Set Up Render"

    def act(self, context: bpy.types.Context) -> None:
        chosen = context.scene.cvdgs.display
        with simulation_lifted(context.scene):
            told = display.set_up_render(context.scene, Engine[chosen.engine], Display[chosen.colors])
        self.report({"INFO"}, f"Changed: {'; '.join(told)}" if told else "The settings already suit Gaussians")


class CVDGS_OT_restore_render(Action, bpy.types.Operator):
    """Put back the render settings that were changed for Gaussians"""

    bl_idname = "cvdgs.restore_render"
    bl_label = "Restore Settings"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        return "" if any(display.render_changes(context.scene)) else "No settings have been changed"

    def act(self, context: bpy.types.Context) -> None:
        with simulation_lifted(context.scene):
            told = display.restore_render(context.scene)
        leave_slow_views(context.scene)
        self.report(
            {"INFO"},
            f"Restored: {'; '.join(told)}" if told else "Nothing to restore: every setting has been changed since",
        )


CLASSES: tuple[type, ...] = (
    CVDGS_OT_show_layer,
    CVDGS_OT_show_form,
    CVDGS_OT_add_crop_box,
    CVDGS_OT_remove_crop_box,
    CVDGS_OT_view_in_color,
    CVDGS_OT_look_around,
    CVDGS_OT_draw_faster,
    CVDGS_OT_add_light,
    CVDGS_OT_add_catcher,
    CVDGS_OT_hide_bystanders,
    CVDGS_OT_hide_other_gaussians,
    CVDGS_OT_place_beside,
    CVDGS_OT_set_up_render,
    CVDGS_OT_restore_render,
)
