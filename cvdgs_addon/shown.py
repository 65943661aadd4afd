"""Which Gaussians the panels are about, and which of their colours are shown."""

from __future__ import annotations

import bpy

from ..core.errors import InputError
from ..core.run_files import ORIGINAL
from .scene.splat_attributes import color_attribute
from .scene.splat_nodes import Input
from .scene.splats import get_input, is_splats

NOTHING_TO_SHOW = "First make a run, or load a finished one"


def shown_splats(context: bpy.types.Context) -> bpy.types.Object | None:
    """The Gaussians of the sub-panel Display: chosen there, else the active object, else the scene's first."""
    chosen = context.scene.cvdgs.display.target
    candidates = [chosen, context.view_layer.objects.active, *context.scene.objects]
    return next((candidate for candidate in candidates if candidate is not None and is_splats(candidate)), None)


def shown_layer(splats: bpy.types.Object) -> tuple[str, float]:
    """The layer that is shown, and how far: 0 for the original colours, 1 for the layer's."""
    layer = str(get_input(splats, Input.LAYER)).removeprefix(color_attribute(""))
    enhanced = get_input(splats, Input.ENHANCED)
    return layer or ORIGINAL, float(enhanced) if isinstance(enhanced, float) else 1.0


def require_object_mode(splats: bpy.types.Object) -> None:
    """Refuse Gaussians that are being edited: their attributes cannot be reached meanwhile.

    Raises:
        InputError: they are.
    """
    if splats.mode == "EDIT":
        raise InputError("the Gaussians are being edited", where=splats.name, remedy="leave Edit Mode first")
