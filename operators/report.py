"""Operator of the sub-panel "Report"."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core.errors import InputError
from ..core.runs.layout import REPORT_PAGE
from ..cvdgs_addon.shown import shown_run
from .base import NeedsRun, reports_errors


class CVDGS_OT_open_report(NeedsRun, bpy.types.Operator):
    """Open the run's report in the web browser: pictures side by side, all figures, timings"""

    bl_idname = "cvdgs.open_report"
    bl_label = "Open Report"

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        page = Path(shown_run(context), REPORT_PAGE)
        if not page.is_file():
            raise InputError("there is no report", where=page, remedy="load the run again from where it is now")
        bpy.ops.wm.url_open(url=page.as_uri())
        return {"FINISHED"}


CLASSES: tuple[type, ...] = (CVDGS_OT_open_report,)
