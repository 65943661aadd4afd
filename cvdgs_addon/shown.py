"""Which Gaussians the panels are about, the run that they came from, and which of their colours are shown."""

from __future__ import annotations

import bpy

from ..core.runs.layout import ORIGINAL
from .scene.origin import run_of
from .scene.recolor import source_layer
from .scene.splat_attributes import Attribute, color_attribute
from .scene.splat_nodes import Input
from .scene.splats import LAYER_BEFORE_UNDO, get_input, is_splats, layer_names, show_layer

NOTHING_TO_SHOW = "Start a run or load a finished one first"
INSTANCE = "{name} shows Gaussians that are linked as an instance: Object > Library Override > Make first"
SWALLOWED = "{name} holds Gaussians, but not the modifier that draws them, as after joining (Ctrl+J) - undo it"
RUN_UNKNOWN = "The run that these Gaussians came from is unknown - load the run again"


def shown_splats(context: bpy.types.Context) -> bpy.types.Object | None:
    """The Gaussians of the sub-panel Display: chosen there, else the active object, else the scene's first."""
    scene = context.scene
    candidates = [scene.cvdgs.display.target, context.view_layer.objects.active, *scene.objects]
    # What is chosen stays chosen when it is deleted from the scene, until the file is saved.
    present = (candidate for candidate in candidates if candidate is not None and candidate.name in scene.objects)
    return next((candidate for candidate in present if is_splats(candidate)), None)


def why_nothing_is_shown(scene: bpy.types.Scene) -> str:
    """What to do where `scene` has no Gaussians of its own.

    *Link* makes an Empty that shows a collection of them; Blender's *Join* keeps the active object's modifiers only.
    """
    instances = {found.instance_collection: found.name for found in scene.objects if found.instance_collection}
    for collection, name in instances.items():
        if any(map(is_splats, collection.all_objects)):
            return INSTANCE.format(name=name)
    for found in scene.objects:
        if found.type == "MESH" and {Attribute.FRAME, Attribute.RANK} <= set(found.data.attributes.keys()):
            return SWALLOWED.format(name=found.name)
    return NOTHING_TO_SHOW


def forget_deleted() -> None:
    """Choose no Gaussians any more that were deleted from all scenes: the file would keep them for good."""
    for scene in bpy.data.scenes:
        if scene.library is None:
            for name in ("target", "partner"):
                _forget_if_deleted(scene.cvdgs.display, name)


def shown_layer(splats: bpy.types.Object) -> tuple[str, float]:
    """The layer that is shown, and how far: 0 for the original colours, 1 for the layer's."""
    layer = str(get_input(splats, Input.LAYER)).removeprefix(color_attribute(""))
    enhanced = get_input(splats, Input.ENHANCED)
    return layer or ORIGINAL, float(enhanced) if isinstance(enhanced, float) else 1.0


def show_source_of_missing_layer(splats: bpy.types.Object) -> None:
    """Show what an edited layer began from where that one is gone: undo in Edit Mode takes it away, but not the choice
    of what is shown.
    """
    layer, enhanced = shown_layer(splats)
    names = layer_names(splats)
    if layer not in names and source_layer(layer) in names:
        show_layer(splats, source_layer(layer), enhanced)
        splats[LAYER_BEFORE_UNDO] = layer


def show_layer_again(splats: bpy.types.Object) -> None:
    """Show an edited layer that redo has brought back, after `show_source_of_missing_layer`, as before undo."""
    edited = splats.get(LAYER_BEFORE_UNDO, "")
    if edited in layer_names(splats):
        show_layer(splats, edited, shown_layer(splats)[1])


def shown_run(context: bpy.types.Context) -> str:
    """The folder of the run that the panels are about, in full; "" where there is none."""
    splats = shown_splats(context)
    return run_of(splats) if splats is not None else ""


def _forget_if_deleted(display: bpy.types.PropertyGroup, name: str) -> None:
    chosen = getattr(display, name)
    if chosen is None or chosen.users_scene:
        return
    setattr(display, name, None)
    if not chosen.users and chosen.library is None:  # Blender would save the mesh of an object that it does not save
        bpy.data.objects.remove(chosen)
