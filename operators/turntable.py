"""Operators of the sub-panel "Turntable"."""

from __future__ import annotations

import math
from pathlib import Path

import bpy

from ..core.errors import InputError
from ..cvdgs_addon.scene.render_settings import Engine
from ..cvdgs_addon.scene.turntable import (
    Turntable,
    add_turntable,
    remove_turntable,
    render_turntable,
    turntable_of,
)
from ..cvdgs_addon.shown import shown_splats
from .base import NeedsGaussians, reports_errors


class CVDGS_OT_add_turntable(NeedsGaussians, bpy.types.Operator):
    """Put a camera on its way around the Gaussians, once around or to and fro in the chosen number of frames"""

    bl_idname = "cvdgs.add_turntable"
    bl_label = "Add Turntable"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        add_turntable(context.scene, shown_splats(context), _chosen(context))
        return {"FINISHED"}


class _OnTurntable:
    """What needs a turntable in the scene."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if turntable_of(context.scene) is None:
            cls.poll_message_set("First add a turntable")  # type: ignore[attr-defined]
            return False
        if bpy.app.is_job_running("RENDER"):
            cls.poll_message_set("Blender renders; wait, or press Esc in its window")  # type: ignore[attr-defined]
            return False
        return True


class CVDGS_OT_render_turntable(_OnTurntable, bpy.types.Operator):
    """Render the turn into numbered pictures; the scene's render settings are as before afterwards"""

    bl_idname = "cvdgs.render_turntable"
    bl_label = "Render Turntable"
    bl_options = {"REGISTER"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        folder = _folder(context)
        render_turntable(context.scene, _chosen(context), folder, wait=True)
        self.report({"INFO"}, f"The pictures are in {folder}")
        return {"FINISHED"}

    @reports_errors
    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        folder = _folder(context)
        render_turntable(context.scene, _chosen(context), folder, wait=False)
        self.report({"INFO"}, f"Rendering into {folder}; Esc in the render window ends it")
        return {"FINISHED"}


class CVDGS_OT_remove_turntable(_OnTurntable, bpy.types.Operator):
    """Delete the turntable's camera; pictures stay"""

    bl_idname = "cvdgs.remove_turntable"
    bl_label = "Remove Turntable"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        remove_turntable(context.scene)
        return {"FINISHED"}


def _chosen(context: bpy.types.Context) -> Turntable:
    chosen = context.scene.cvdgs.turntable
    return Turntable(
        frames=chosen.frames,
        radius=chosen.radius,
        height=chosen.height,
        focal_length=chosen.focal_length,
        arc=math.degrees(chosen.arc),
        width=chosen.width,
        height_pixels=chosen.height_pixels,
        engine=Engine[chosen.engine] if chosen.engine != "SCENE" else None,
    )


def _folder(context: bpy.types.Context) -> Path:
    """The chosen folder in full.

    Raises:
        InputError: it lies beside a file that was never saved.
    """
    folder = context.scene.cvdgs.turntable.folder
    if not folder or (folder.startswith("//") and not bpy.data.filepath):
        raise InputError(
            "the folder lies beside the .blend, which is not saved yet",
            where="Turntable",
            remedy="save the file, or choose a folder",
        )
    return Path(bpy.path.abspath(folder))


CLASSES: tuple[type, ...] = (CVDGS_OT_add_turntable, CVDGS_OT_render_turntable, CVDGS_OT_remove_turntable)
