"""Sub-panel "Display": what the Gaussians are drawn as, in which colours, how many, and what renders need."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.scene import crop, display
from ..cvdgs_addon.scene.apart import objects_scene
from ..cvdgs_addon.scene.bystanders import bystanders, has_rigid_bodies
from ..cvdgs_addon.scene.camera_view import smooths_slowly
from ..cvdgs_addon.scene.display import Form
from ..cvdgs_addon.scene.masks import Treatment
from ..cvdgs_addon.scene.native_splats import has_native_splats
from ..cvdgs_addon.scene.neighbours import overlapping, partner_of
from ..cvdgs_addon.scene.relight import is_relit
from ..cvdgs_addon.scene.render_settings import REC709, fog_of, other_working_space, what_changes_colors
from ..cvdgs_addon.scene.splat_attributes import HOW_TO_JOIN, JOINED, is_joined
from ..cvdgs_addon.scene.splat_nodes import Input
from ..cvdgs_addon.scene.splats import input_property, layer_names
from ..cvdgs_addon.shown import shown_layer
from .layout import GaussiansPanel, complain, draw_changes, say, split_column

_MOST_NAMES = 3
_TREATMENTS = {
    Treatment.REMOVE: "Remove Selected",
    Treatment.KEEP_ORIGINAL: "Keep Original Colours",
    Treatment.RESTORE: "Use Layer's Colours",
}
_FORM_LABELS = {Form.PREVIEW: "Preview", Form.INSTANCES: "Instances", Form.POINTS: "Points", Form.NATIVE: "Native"}


class CVDGS_PT_display(GaussiansPanel, bpy.types.Panel):
    """How the Gaussians are displayed."""

    bl_idname = "CVDGS_PT_display"
    bl_label = "Display"

    def draw_for(self, context: bpy.types.Context, splats: bpy.types.Object) -> None:
        layout = self.layout
        layout.prop(context.scene.cvdgs.display, "target", text="", icon="OUTLINER_OB_POINTCLOUD")
        column = layout.column(align=True)
        column.operator("cvdgs.view_in_color", icon="SHADING_RENDERED")
        column.operator("cvdgs.look_around", icon="SHADING_TEXTURE")
        _draw_hints(layout, context, splats)
        _draw_form(layout, context, splats)
        _draw_layers(layout, splats)
        _draw_selection(layout, splats)
        _draw_clean_up(layout)
        _draw_relight(layout, context, splats)
        _draw_render(layout, context)
        if display.form_of(splats) is Form.PREVIEW and smooths_slowly(context):
            layout.operator("cvdgs.draw_faster", icon="TIME")


def _draw_hints(layout: bpy.types.UILayout, context: bpy.types.Context, splats: bpy.types.Object) -> None:
    """Why the 3D view may not show, or the file not keep, what is expected."""
    if splats.library is not None:
        say(layout, context, "Linked from another file, so what you set here is not saved", "LINKED")
    if is_joined(splats.data):
        complain(layout, context, f"{JOINED} - {HOW_TO_JOIN}")
    elif len(splats.data.polygons):
        complain(layout, context, "A mesh that was joined with these Gaussians (Ctrl+J) is not drawn - undo it")
    shading = context.space_data.shading if context.space_data is not None else None
    is_preview = display.form_of(splats) is Form.PREVIEW
    if shading is not None and shading.type == "SOLID" and not (is_preview and shading.color_type == "VERTEX"):
        press = "Press Preview to see its colours in Solid shading"
        say(layout, context, press if is_preview else "Solid shading shows the colours of the Preview only", "INFO")
    say_bystanders(layout, context, "The view also shows")
    others = [other.name for other in overlapping(context.scene, splats)]
    if others:
        say(layout, context, f"These overlap: {splats.name}, {_listed(others)}", "INFO")
        row = layout.row(align=True)
        row.operator("cvdgs.hide_other_gaussians", text="Hide Others", icon="HIDE_ON")
        row.operator("cvdgs.place_beside", icon="FORWARD")
    _draw_alignment(layout, context, splats)


def _draw_alignment(layout: bpy.types.UILayout, context: bpy.types.Context, splats: bpy.types.Object) -> None:
    """Offered where there are two runs: how to bring them onto each other, and to make one of them."""
    chosen = context.scene.cvdgs.display
    if partner_of(context.scene, splats, chosen.partner) is None:
        return
    header, body = layout.panel("cvdgs_alignment", default_closed=True)
    header.label(text="Align and Join Runs")
    if body is None:
        return
    split_column(body).prop(chosen, "partner")
    column = body.column(align=True)
    column.operator("cvdgs.align_photographs", icon="OUTLINER_OB_CAMERA")
    pick = column.column(align=True)
    pick.operator_context = "INVOKE_DEFAULT"
    pick.operator("cvdgs.pick_marks", icon="RESTRICT_SELECT_OFF")
    column.operator("cvdgs.add_marks", icon="EMPTY_AXIS")
    column.operator("cvdgs.align_marks", icon="SNAP_ON")
    say(body, context, "Pick the same places in both runs, or move each pair of marks there, then align", "INFO")
    body.operator("cvdgs.join_runs", icon="SELECT_EXTEND")


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


def _draw_form(layout: bpy.types.UILayout, context: bpy.types.Context, splats: bpy.types.Object) -> None:
    row, current = layout.row(align=True), display.form_of(splats)
    for form, label in _FORM_LABELS.items():
        button = row.row(align=True)
        button.enabled = form is not Form.NATIVE or has_native_splats()
        button.operator("cvdgs.show_form", text=label, depress=form is current).form = form.value
    if current is Form.INSTANCES:
        _draw_input(layout, splats, Input.CAMERA_VIEW, "Fast View (wrong from elsewhere)")
    if current is Form.POINTS:
        _draw_input(layout, splats, Input.POINT_SIZE)
    if current is Form.NATIVE:
        say(layout, context, "A copy; press Native again to update it after a change", "INFO")


def _draw_layers(layout: bpy.types.UILayout, splats: bpy.types.Object) -> None:
    current, _ = shown_layer(splats)
    column = layout.column(align=True)
    for layer in layer_names(splats):
        column.operator("cvdgs.show_layer", text=layer, depress=layer == current).layer = layer
    _draw_input(layout, splats, Input.ENHANCED, "Original – Enhanced", slider=True)


def _draw_selection(layout: bpy.types.UILayout, splats: bpy.types.Object) -> None:
    row = layout.row(align=True)
    _draw_input(row, splats, Input.BUDGET, "Max Gaussians (0: all)")
    _draw_input(row, splats, Input.BUDGET_IN_RENDERS, "", icon="RESTRICT_RENDER_OFF")
    row = layout.row(align=True)
    if crop.crop_box_of(splats) is None:
        row.operator("cvdgs.add_crop_box", icon="MESH_CUBE")
    else:
        _draw_input(row, splats, Input.CROP, "Crop", toggle=True)
        row.operator("cvdgs.add_crop_box", text="Select Box", icon="RESTRICT_SELECT_OFF")
        row.operator("cvdgs.remove_crop_box", text="", icon="X")


def _draw_clean_up(layout: bpy.types.UILayout) -> None:
    header, body = layout.panel("cvdgs_clean_up", default_closed=True)
    header.label(text="Select and Clean Up")
    if body is None:
        return
    column = body.column(align=True)
    column.operator("cvdgs.edit_points", icon="RESTRICT_SELECT_OFF")
    row = column.row(align=True)
    row.operator_context = "INVOKE_DEFAULT"
    for name, text in (("color", "Colour"), ("floaters", "Floaters"), ("box", "Crop Box")):
        row.operator(f"cvdgs.select_{name}", text=text)
    column = body.column(align=True)
    for treatment in Treatment:
        column.operator("cvdgs.treat_selected", text=_TREATMENTS[treatment]).treatment = treatment.value
    popup = column.column(align=True)
    popup.operator_context = "INVOKE_DEFAULT"
    popup.operator("cvdgs.recolor_selected", icon="COLOR")
    column = body.column(align=True)
    column.operator("cvdgs.remove_floaters", icon="BRUSH_DATA")
    column.operator("cvdgs.take_all_back", icon="LOOP_BACK")


def _draw_relight(layout: bpy.types.UILayout, context: bpy.types.Context, splats: bpy.types.Object) -> None:
    header, body = layout.panel("cvdgs_relight", default_closed=True)
    header.label(text="Relight (a guess)")
    if body is None:
        return
    row = body.row(align=True)
    row.operator("cvdgs.relight", icon="LIGHT_SUN")
    if not is_relit(splats):
        return
    row.operator("cvdgs.take_light_back", text="", icon="X")
    _draw_input(body, splats, Input.RELIGHT, slider=True)
    _draw_input(body, splats, Input.LAMP)
    say(body, context, "Rotate the lamp. It casts no shadows; those in the photographs remain", "INFO")


def _draw_render(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    chosen = context.scene.cvdgs.display
    box = layout.box()
    column = split_column(box)
    column.prop(chosen, "engine")
    column.prop(chosen, "colors")
    if chosen.colors == "SCENE_LINEAR":
        _draw_lamps(box, context)
    fog = fog_of(context.scene)
    if fog:
        say(box, context, fog, "ERROR")
    row = box.row(align=True)
    row.operator("cvdgs.set_up_render", icon="SCENE")
    row.operator("cvdgs.restore_render", text="Restore", icon="LOOP_BACK")
    say_unsuitable_view(box, context)
    draw_changes(layout, context, "cvdgs_render_changes", list(display.render_changes(context.scene)))


def _draw_lamps(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What an artist's own objects need to stand in the scene."""
    say(layout, context, "Lamps light your objects, not the Gaussians", "INFO")
    other = other_working_space()
    if other:
        say(layout, context, f"Working space {other} shifts the Gaussians' colours; choose {REC709}", "ERROR")
    if context.scene.cvdgs.display.engine == "CYCLES" and has_rigid_bodies(context.scene):
        say(layout, context, "Renders do not move rigid bodies; use Object > Rigid Body > Bake to Keyframes", "ERROR")
    column = layout.column(align=True)
    column.operator("cvdgs.add_light", icon="LIGHT_SUN")
    column.operator("cvdgs.add_catcher", icon="MESH_PLANE")
    objects = objects_scene(context.scene)
    if objects is not None:
        column = split_column(layout)
        column.prop(objects.cycles, "samples", text="Samples, Objects")
        column.prop(objects.cycles, "max_bounces", text="Bounces")
        column.prop(objects.cycles, "use_denoising", text="Denoise Objects")


def say_unsuitable_view(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Say what in the scene's colour management changes the photographs' colours, where it does."""
    changes = what_changes_colors(context.scene)
    if changes:
        say(layout, context, f"{changes} changes the photographs' colours; Set Up Render fixes that", "INFO")


def say_bystanders(layout: bpy.types.UILayout, context: bpy.types.Context, text: str) -> None:
    """Name what renders show beside the Gaussians, such as the cube of a new file."""
    others = bystanders(context.scene)
    if others:
        say(layout, context, f"{text} {_listed(others)}", "INFO")
        button = f"Hide {others[0]}" if len(others) == 1 else f"Hide {len(others)} Objects"
        layout.operator("cvdgs.hide_bystanders", text=button, icon="HIDE_ON")


def _draw_input(
    layout: bpy.types.UILayout, splats: bpy.types.Object, name: Input, text: str | None = None, **options: object
) -> None:
    """An input of the modifier, which can be keyed and driven here as there."""
    owner, path = input_property(splats, name)
    layout.prop(owner, path, text=str(name) if text is None else text, **options)
