"""Operators of "Relight", a part of the sub-panel Display."""

from __future__ import annotations

import bpy

from ..cvdgs_addon.scene import relight
from ..cvdgs_addon.scene.splat_attributes import require_object_mode
from ..cvdgs_addon.shown import shown_splats
from .base import ChangesGaussians


class CVDGS_OT_relight(ChangesGaussians, bpy.types.Operator):
    """Shade the Gaussians by the active lamp, or a new one. They throw no shadows; those of the photographs stay"""

    bl_idname = "cvdgs.relight"
    bl_label = "Relight by a Lamp"

    def act(self, context: bpy.types.Context) -> None:
        splats, active = shown_splats(context), context.active_object
        require_object_mode(splats)
        lamp = relight.relight(splats, context.scene, active if active is not None and active.type == "LIGHT" else None)
        self.report({"INFO"}, f"Shaded by {lamp.name}: rotate it")


class CVDGS_OT_take_light_back(ChangesGaussians, bpy.types.Operator):
    """Show the light of the photographs alone again; the lamp stays"""

    bl_idname = "cvdgs.take_light_back"
    bl_label = "Remove Relighting"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str:
        splats = shown_splats(context)
        lit = splats is not None and relight.is_relit(splats)
        return super().missing(context) or ("" if lit else "These Gaussians are not relit")

    def act(self, context: bpy.types.Context) -> None:
        require_object_mode(shown_splats(context))
        relight.take_light_back(shown_splats(context))


CLASSES: tuple[type, ...] = (CVDGS_OT_relight, CVDGS_OT_take_light_back)
