"""Gaussians in colour at once: which form suits the shading of the 3D views, and views that show the preview."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from .camera_view import has_graphics_card, views_3d
from .display import Form, form_of, show_form
from .splat_nodes import Input
from .splats import get_input, is_splats, set_input

LOOK_AROUND_BUDGET = 3000
"""Gaussians of Material Preview without a graphics card; a redraw takes seconds even of these."""

_BUDGET_BEFORE = "cvdgs_budget_before"  # custom property of Gaussians whose budget is lowered for looking around


def show_in_color(scene: bpy.types.Scene) -> None:
    """Let the open 3D views show the Gaussians of `scene` in colour, as fast as this machine can.

    With a graphics card that is Material Preview; without one it would hold Blender up for a minute, and Solid shading
    shows the preview. Views that render in Cycles stay as they are, unless what was added would hold them up; so do
    Gaussians in a form that somebody chose.
    """
    if has_graphics_card():
        _give_form(scene, Form.INSTANCES, of=Form.PREVIEW)
        for view in views_3d():
            if view.shading.type == "SOLID":
                view.shading.type = "MATERIAL"
        return
    # What was just added is drawn as ellipsoids, which would take minutes to render beside what was there.
    slow = any(
        form_of(splats) is Form.INSTANCES and not get_input(splats, Input.CAMERA_VIEW) for splats in _shown(scene)
    )
    for view in views_3d():
        if slow or view.shading.type in ("SOLID", "MATERIAL"):
            shade_flat(view)
    follow_shading(scene, views_3d())


def shade_flat(view: bpy.types.SpaceView3D) -> None:
    """Solid shading in the colours of attributes, without a light of the view's own."""
    view.shading.type = "SOLID"
    view.shading.light, view.shading.color_type = "FLAT", "VERTEX"
    view.shading.show_object_outline = False  # around thousands of quads


def follow_shading(scene: bpy.types.Scene, views: Iterable[bpy.types.SpaceView3D]) -> None:
    """Give the Gaussians the form that suits what `views` show: quads for Solid, discs for a render in Cycles.

    Without a graphics card Material Preview and EEVEE keep the form that there is.
    """
    views = list(views)
    shadings = {view.shading.type for view in views}
    is_cycles = scene.render.engine == "CYCLES"
    if has_graphics_card():
        slow, fast = set(), {"MATERIAL", "RENDERED"}
    else:
        slow, fast = {"MATERIAL"} | (set() if is_cycles else {"RENDERED"}), {"RENDERED"} if is_cycles else set()
    if shadings & fast:
        _give_form(scene, Form.INSTANCES, of=Form.PREVIEW)
    elif shadings and not shadings & slow:
        end_looking_around(scene)
        if _give_form(scene, Form.PREVIEW, of=Form.INSTANCES):
            for view in views:
                if view.shading.type == "SOLID":
                    shade_flat(view)


def look_around(scene: bpy.types.Scene, view: bpy.types.SpaceView3D) -> None:
    """Show the Gaussians in Material Preview from wherever somebody looks: without a card, the most important ones."""
    for splats in filter(is_splats, scene.objects):
        show_form(splats, Form.INSTANCES)
        set_input(splats, Input.CAMERA_VIEW, False)
        budget = get_input(splats, Input.BUDGET)
        assert isinstance(budget, int)
        if not has_graphics_card() and not 0 < budget <= LOOK_AROUND_BUDGET:
            splats[_BUDGET_BEFORE] = budget
            set_input(splats, Input.BUDGET, LOOK_AROUND_BUDGET)
    if view.region_3d.view_perspective == "CAMERA":
        view.region_3d.view_perspective = "PERSP"
    view.shading.type = "MATERIAL"


def end_looking_around(scene: bpy.types.Scene) -> None:
    """Put the budget back that was there before."""
    for splats in scene.objects:
        if _BUDGET_BEFORE in splats:
            before = splats.pop(_BUDGET_BEFORE)
            if get_input(splats, Input.BUDGET) == LOOK_AROUND_BUDGET:
                set_input(splats, Input.BUDGET, before)


def _shown(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    return [splats for splats in scene.objects if is_splats(splats) and not splats.hide_viewport]


def _give_form(scene: bpy.types.Scene, form: Form, of: Form) -> bool:
    """Whether there were Gaussians of the form `of`, which have `form` now."""
    found = [splats for splats in scene.objects if is_splats(splats) and form_of(splats) is of]
    for splats in found:
        show_form(splats, form)
    return bool(found)
