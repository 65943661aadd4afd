"""Operators of the part "Align and Join Runs" of the sub-panel "Display"."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..cvdgs_addon.joining import join
from ..cvdgs_addon.picking_marks import Picking, ray_below
from ..cvdgs_addon.scene.alignment import Alignment, add_marks, align_by_marks, align_by_photographs, metric
from ..cvdgs_addon.scene.neighbours import partner_of
from ..cvdgs_addon.scene.splat_attributes import refuse_joined, require_object_mode
from ..cvdgs_addon.shown import shown_splats
from .base import NeedsGaussians


class _OfTwoRuns(NeedsGaussians):
    """An operator on the Gaussians that are shown and on those that they are aligned with."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        reason = super().missing(context)
        return reason or ("" if _partner(context) is not None else "Load another run of the same place first")


class CVDGS_OT_add_marks(_OfTwoRuns, bpy.types.Operator):
    """Add three pairs of marks, one of each pair to either run, or one pair more; move them to the same places"""

    bl_idname = "cvdgs.add_marks"
    bl_label = "Add Marks"

    def act(self, context: bpy.types.Context) -> None:
        marks = add_marks(shown_splats(context), _partner(context))
        self.report({"INFO"}, f"Added {', '.join(mark.name for mark in marks)}")


class _Aligns(_OfTwoRuns):
    """An operator that moves one run onto the other."""

    def fit(self, moved: bpy.types.Object, fixed: bpy.types.Object) -> Alignment:
        """Each operator its own."""
        raise AssertionError

    def act(self, context: bpy.types.Context) -> None:
        moved, fixed = _in_order(context)
        found = self.fit(moved, fixed)
        self.report({"INFO"}, f"Moved {moved.name}: {found.in_words}")  # type: ignore[attr-defined]


class CVDGS_OT_align_marks(_Aligns, bpy.types.Operator):
    """Move one run so that its marks come onto those of the other; both keep their shape"""

    bl_idname = "cvdgs.align_marks"
    bl_label = "Align by Marks"

    def fit(self, moved: bpy.types.Object, fixed: bpy.types.Object) -> Alignment:
        return align_by_marks(moved, fixed)


class CVDGS_OT_pick_marks(_Aligns, bpy.types.Operator):
    """Click three or more places of one run, then the same places of the other; they are aligned then"""

    bl_idname = "cvdgs.pick_marks"
    bl_label = "Pick Marks"

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        owners = (shown_splats(context), _partner(context))
        for owner in owners:
            assert owner is not None  # see `_OfTwoRuns.missing`
            require_object_mode(owner)
            refuse_joined(owner.data)
            if context.view_layer.objects.get(owner.name) != owner:
                remedy = "tick its collection in the Outliner, or choose other Gaussians"
                raise InputError("it is not in this view layer", where=owner.name, remedy=remedy)
        self._pick = Picking(owners)  # type: ignore[attr-defined]
        self._pick.show()
        context.workspace.status_text_set(self._pick.in_words)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Clicks choose, Enter goes on, Esc takes back; all else is Blender's, so that the view can be turned.

        But for its undo, after which the two runs would be other objects than those that are being picked in.
        """
        pick, is_press = self._pick, event.value == "PRESS"  # type: ignore[attr-defined]
        ray = ray_below(context.window, event) if event.type == "LEFTMOUSE" and is_press else None
        if event.type == "ESC" and is_press:
            pick.take_back()
        elif event.type in ("RET", "NUMPAD_ENTER") and is_press:
            pick.go_on()
        elif ray is not None:
            pick.add(*ray)
        elif not (event.type == "Z" and (event.ctrl or event.oskey)):
            return {"PASS_THROUGH"}
        context.workspace.status_text_set(None if pick.has_ended else pick.in_words)
        if not pick.has_ended:
            return {"RUNNING_MODAL"}
        return self._attempt(self.act, context) if pick.is_complete else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender where it ends this by itself, such as before it opens another file."""
        self._pick.take_back()  # type: ignore[attr-defined]
        context.workspace.status_text_set(None)

    def fit(self, moved: bpy.types.Object, fixed: bpy.types.Object) -> Alignment:
        return align_by_marks(moved, fixed)


class CVDGS_OT_align_photographs(_Aligns, bpy.types.Operator):
    """Move one run so that the cameras of photographs which both have, by name, come onto each other"""

    bl_idname = "cvdgs.align_photographs"
    bl_label = "Align by Photographs"

    def fit(self, moved: bpy.types.Object, fixed: bpy.types.Object) -> Alignment:
        return align_by_photographs(moved, fixed)


class CVDGS_OT_join_runs(_OfTwoRuns, bpy.types.Operator):
    """Make one object of the Gaussians of both, as they stand; the two stay in the file, hidden. Align them first"""

    bl_idname = "cvdgs.join_runs"
    bl_label = "Join Runs"

    def act(self, context: bpy.types.Context) -> None:
        moved, fixed = _in_order(context)
        joined = join(context.scene, fixed, moved)
        self.report({"INFO"}, f"Made {joined.name}; {fixed.name} and {moved.name} are hidden")


def _in_order(context: bpy.types.Context) -> tuple[bpy.types.Object, bpy.types.Object]:
    """The run that follows, and the one that stays: the shown one follows, unless it alone knows its size in metres."""
    splats, partner = shown_splats(context), _partner(context)
    assert splats is not None  # see `_OfTwoRuns.missing`
    assert partner is not None
    return (partner, splats) if metric(splats) and not metric(partner) else (splats, partner)


def _partner(context: bpy.types.Context) -> bpy.types.Object | None:
    return partner_of(context.scene, shown_splats(context), context.scene.cvdgs.display.partner)


CLASSES: tuple[type, ...] = (
    CVDGS_OT_add_marks,
    CVDGS_OT_pick_marks,
    CVDGS_OT_align_marks,
    CVDGS_OT_align_photographs,
    CVDGS_OT_join_runs,
)
"""Reached from the panel and by search."""
