"""Which view layers, collections and objects Blender renders, or would if nothing were rendered apart (see `apart`)."""

from __future__ import annotations

import json
from collections.abc import Iterator

import bpy

# Custom properties of view layers, which artists rename: those that were ticked, and the one that renders nothing.
_WAS_TICKED, _IS_EMPTY = "cvdgs_rendered_layer", "cvdgs_empty_layer"
_NAMES_OF_TICKED = "cvdgs_rendered_layers"  # custom property of the scene, in files of earlier releases
_EMPTY_LAYER = "CVD Rendered Apart"


def untick_layers(scene: bpy.types.Scene) -> None:
    """Let `scene` render nothing, by a view layer that is empty once `empty_layers` of it are excluded."""
    for layer in scene.view_layers:
        if layer.use:
            layer[_WAS_TICKED], layer.use = True, False
    scene.view_layers.new(_EMPTY_LAYER)[_IS_EMPTY] = True  # Blender renders no scene without any


def tick_layers_again(scene: bpy.types.Scene) -> None:
    """Undo `untick_layers`."""
    for layer in _layers_of_artist(scene):
        layer.use = _is_ticked(scene, layer)
        layer.pop(_WAS_TICKED, None)
    scene.pop(_NAMES_OF_TICKED, None)
    for empty in empty_layers(scene):
        if len(scene.view_layers) > 1:
            scene.view_layers.remove(empty)


def empty_layers(scene: bpy.types.Scene) -> list[bpy.types.ViewLayer]:
    """View layers that `untick_layers` made."""
    return [layer for layer in scene.view_layers if layer.get(_IS_EMPTY) or layer.name == _EMPTY_LAYER]


def rendered_objects(scene: bpy.types.Scene) -> set[bpy.types.Object]:
    """What the artist's ticked view layers have and no collection hides, also what its own `hide_render` hides."""
    layers = _layers_of_artist(scene)
    chosen = [layer for layer in layers if _is_ticked(scene, layer)] or layers  # renamed in an earlier release
    for layer in chosen:
        if layer.layer_collection is None:
            layer.update()  # Blender 5.2 knows the collections of a scene that no window has shown only then
    collections = {
        found for layer in chosen for found in collections_in(layer.layer_collection, hidden_by="hide_render")
    }
    return {found for collection in collections for found in collection.objects}


def collections_in(branch: bpy.types.LayerCollection, *, hidden_by: str) -> Iterator[bpy.types.Collection]:
    """A branch's collection and those in it that are neither excluded nor hidden.

    Args:
        branch: of a view layer; all of it by ``view_layer.layer_collection``.
        hidden_by: what hides a collection with all that is in it, "hide_render" or "hide_viewport".
    """
    if getattr(branch.collection, hidden_by):
        return
    if not branch.exclude:
        yield branch.collection
    for child in branch.children:  # one that is excluded may have some that are not
        yield from collections_in(child, hidden_by=hidden_by)


def _layers_of_artist(scene: bpy.types.Scene) -> list[bpy.types.ViewLayer]:
    return [layer for layer in scene.view_layers if not layer.get(_IS_EMPTY) and layer.name != _EMPTY_LAYER]


def _is_ticked(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bool:
    """Whether the artist's view layer is to be rendered: Blender renders it, or would without `untick_layers`."""
    return layer.use or bool(layer.get(_WAS_TICKED)) or layer.name in json.loads(scene.get(_NAMES_OF_TICKED, "[]"))
