"""Where objects that belong to another are linked: beside it, in collections of the open scene that can be changed."""

from __future__ import annotations

import bpy


def collections_of(thing: bpy.types.Object) -> list[bpy.types.Collection]:
    """Those of the open scene that `thing` is in and that can be changed; the scene's own where there is none.

    `Object.users_collection` also has linked ones, and those of the scenes that render objects apart from Gaussians.
    """
    own = bpy.context.scene.collection
    of_scene = {own, *own.children_recursive}
    found = [collection for collection in thing.users_collection if collection in of_scene and _is_ours(collection)]
    return found or [own]


def link_beside(thing: bpy.types.Object, added: bpy.types.Object) -> None:
    """Link `added` where `thing` is, wherever it is not linked yet."""
    for collection in collections_of(thing):
        if added.name not in collection.objects:
            collection.objects.link(added)


def _is_ours(collection: bpy.types.Collection) -> bool:
    return collection.library is None and collection.override_library is None
