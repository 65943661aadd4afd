"""Sub-panel "Report": the figures of the run that the Gaussians came from."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.results import figures_of, read_report
from ..cvdgs_addon.shown import NOTHING_TO_SHOW, RUN_UNKNOWN, run_of, shown_splats
from .layout import SidePanel, say_missing


class CVDGS_PT_report(SidePanel, bpy.types.Panel):
    """How well it went."""

    bl_idname = "CVDGS_PT_report"
    bl_label = "Report"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, splats = self.layout, shown_splats(context)
        if splats is None:
            say_missing(layout, context, NOTHING_TO_SHOW)
            return
        folder = run_of(splats)
        if not folder:
            say_missing(layout, context, RUN_UNKNOWN)
            return
        report = read_report(folder)
        if not report:
            say_missing(layout, context, f"There is no report in {folder} - load the run again from where it is now")
            return
        for heading, rows in figures_of(report).items():
            box = layout.box()
            box.label(text=heading)
            column = box.column(align=True)
            for name, value in rows:
                split = column.split(factor=0.72)
                split.label(text=name)
                right = split.row()
                right.alignment = "RIGHT"
                right.label(text=value)
        layout.operator("cvdgs.open_report", icon="URL")


CLASSES: tuple[type, ...] = (CVDGS_PT_report,)
