"""Operators of the sub-panel "Turntable"."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

import bpy

from ..core.errors import InputError
from ..cvdgs_addon.scene.render_settings import Engine
from ..cvdgs_addon.scene.turntable import (
    Turntable,
    add_turntable,
    is_rendering,
    remove_turntable,
    render_turntable,
    turntable_of,
)
from ..cvdgs_addon.shown import shown_splats
from .base import NOT_REPEATED, Action, NeedsGaussians


class CVDGS_OT_add_turntable(NeedsGaussians, bpy.types.Operator):
    """Add a camera that orbits the Gaussians, or swings to and fro, in the chosen number of frames"""

    bl_idname = "cvdgs.add_turntable"
    bl_label = "Add Turntable"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        return super().missing(context) or _busy()

    def act(self, context: bpy.types.Context) -> None:
        add_turntable(context.scene, shown_splats(context), _chosen(context))


class _NeedsTurntable(Action):
    """An operator on the turntable of the scene, while Blender does not render."""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        if turntable_of(context.scene) is None:
            return "Add a turntable first"
        return _busy()


class CVDGS_OT_render_turntable(_NeedsTurntable, bpy.types.Operator):
    """Render one turn as numbered images; the scene's render settings are restored afterwards"""

    bl_idname = "cvdgs.render_turntable"
    bl_label = "Render Turntable"
    bl_options = NOT_REPEATED

    def act(self, context: bpy.types.Context) -> None:
        folder = _folder(context)
        render_turntable(context.scene, _chosen(context), folder, wait=True)
        self.report({"INFO"}, f"Images written to {folder}")

    def on_click(self, context: bpy.types.Context, _event: bpy.types.Event) -> None:
        folder = _folder(context)
        render_turntable(context.scene, _chosen(context), folder, wait=False)
        self.report({"INFO"}, f"Rendering to {folder}; press Esc in the render window to stop")


class CVDGS_OT_remove_turntable(_NeedsTurntable, bpy.types.Operator):
    """Delete the turntable's camera; rendered images are kept"""

    bl_idname = "cvdgs.remove_turntable"
    bl_label = "Remove Turntable"

    def act(self, context: bpy.types.Context) -> None:
        remove_turntable(context.scene)


def _busy() -> str:
    """Why a turntable cannot be changed at the moment; "" where it can be."""
    return "Blender is rendering; wait, or press Esc in the render window" if is_rendering() else ""


def _chosen(context: bpy.types.Context) -> Turntable:
    chosen = context.scene.cvdgs.turntable
    values = {field.name: getattr(chosen, field.name) for field in fields(Turntable)}
    engine = Engine[chosen.engine] if chosen.engine != "SCENE" else None
    height = chosen.height if chosen.has_height else None
    return Turntable(**{**values, "height": height, "arc": math.degrees(chosen.arc), "engine": engine})


def _folder(context: bpy.types.Context) -> Path:
    """The chosen folder in full.

    Raises:
        InputError: it lies beside a file that was never saved.
    """
    folder = context.scene.cvdgs.turntable.folder
    if not folder or (folder.startswith("//") and not bpy.data.filepath):
        raise InputError(
            "the folder is relative to the .blend file, which has not been saved",
            where="Turntable",
            remedy="save the file, or choose another folder",
        )
    return Path(bpy.path.abspath(folder))


CLASSES: tuple[type, ...] = (CVDGS_OT_add_turntable, CVDGS_OT_render_turntable, CVDGS_OT_remove_turntable)
