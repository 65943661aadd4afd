"""What all sub-panels share: their place, and text that is wrapped to the panel's width."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.background import BackgroundJob, State
from ..cvdgs_addon.messages import lines_of
from ..cvdgs_addon.shown import shown_splats, why_nothing_is_shown

_CHARACTER_WIDTH = 6.2  # pixels of a character of the interface font on average, at a scale of 1
_MARGIN = 68.0  # pixels beside the text: tabs, borders (of a box as well), icon, scroll bar
_FEWEST_CHARACTERS = 16


class SidePanel:
    """Place of a sub-panel: the side bar of the 3D view, tab "CVD"."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CVD"


class GaussiansPanel(SidePanel):
    """A sub-panel about the Gaussians that are shown; where there are none, it says what to do."""

    def draw(self, context: bpy.types.Context) -> None:
        splats = shown_splats(context)
        if splats is None:
            say(self.layout, context, why_nothing_is_shown(context.scene), "INFO")  # type: ignore[attr-defined]
        else:
            self.draw_for(context, splats)

    def draw_for(self, context: bpy.types.Context, splats: bpy.types.Object) -> None:
        """Draw the sub-panel for `splats`. Each panel has its own."""


def split_column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column of properties with their names on the left."""
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    return column


def say_end(layout: bpy.types.UILayout, context: bpy.types.Context, job: BackgroundJob | None) -> None:
    """Say how the last job ended, where it did not reach its end."""
    if job is not None and job.state is State.FAILED:
        complain(layout, context, job.problem)
    elif job is not None and job.state is State.CANCELLED:
        say(layout, context, "Cancelled; no results were changed", "INFO")


def say(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE") -> None:
    """Show `text` in as many lines as the region's width needs, with an icon at the first."""
    scale = context.preferences.system.ui_scale or 1.0
    width = context.region.width if context.region else 250
    characters = max(int((width / scale - _MARGIN) / _CHARACTER_WIDTH), _FEWEST_CHARACTERS)
    column = layout.column(align=True)
    column.scale_y = 0.85
    for number, line in enumerate(lines_of(text, characters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


def draw_changes(layout: bpy.types.UILayout, context: bpy.types.Context, name: str, changes: list[str]) -> None:
    """How many settings of the scene are changed until they are restored; opened, which.

    Args:
        layout: where.
        context: of the panel.
        name: under which Blender remembers whether it is open.
        changes: in words.
    """
    if not changes:
        return
    header, body = layout.panel(name, default_closed=True)
    header.label(text=f"{len(changes)} Settings Changed" if len(changes) > 1 else "1 Setting Changed")
    if body is not None:
        for change in changes:
            say(body, context, change)


def complain(layout: bpy.types.UILayout, context: bpy.types.Context, text: str) -> None:
    """Say what is wrong and what to do, in a box."""
    box = layout.box()
    box.alert = True
    say(box, context, text, "ERROR")
