"""What all operators share: when they can be used, and what is wrong as a report of one line, which Blender pops up."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..core.errors import InputError
from ..core.runtime.supervisor import WorkerDefect
from ..cvdgs_addon.messages import in_panel_words
from ..cvdgs_addon.shown import NOTHING_TO_SHOW, RUN_UNKNOWN, shown_run, shown_splats

NOT_REPEATED: set[str] = set()
"""Options of an operator that works in the background after a click: Shift+R repeats what Blender has registered by
`execute`, which waits for the end.
"""
LINKED = "Linked from another file: Object > Relations > Make Local > Selected Objects and Data first"


class Action:
    """An operator that does something or reports in one line why it cannot; mixed in before `bpy.types.Operator`."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def missing(cls, _context: bpy.types.Context) -> str:
        """What has to be done before the operator can be used; "" where it can be."""
        return ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reason = cls.missing(context)
        if reason:
            cls.poll_message_set(in_panel_words(reason))  # type: ignore[attr-defined]
        return not reason

    def act(self, context: bpy.types.Context) -> set[str] | None:
        """Do it, for a script too; each operator its own way. May return Blender's result if not "finished"."""
        return None

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str] | None:
        """Do it for somebody who clicked, who must not be held up and can be asked."""
        return self.act(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._attempt(self.act, context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self._attempt(self.on_click, context, event)

    def _attempt(self, what: Callable[..., set[str] | None], *arguments: object) -> set[str]:
        try:
            return what(*arguments) or {"FINISHED"}
        except (InputError, WorkerDefect) as error:
            self.report({"ERROR"}, in_panel_words(str(error)))  # type: ignore[attr-defined]
            return {"CANCELLED"}


class NeedsGaussians(Action):
    """An operator on the Gaussians of the sub-panel Display."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        return NOTHING_TO_SHOW if shown_splats(context) is None else ""


class ChangesGaussians(NeedsGaussians):
    """An operator that changes these Gaussians: their object and its mesh have to be of the open file."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        splats = shown_splats(context)
        linked = splats is not None and (splats.library is not None or splats.data.library is not None)
        return super().missing(context) or (LINKED if linked else "")


class NeedsRun(NeedsGaussians):
    """An operator on files of the run that these Gaussians came from."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        return super().missing(context) or ("" if shown_run(context) else RUN_UNKNOWN)
