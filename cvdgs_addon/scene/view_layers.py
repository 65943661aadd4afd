"""Which collections of a view layer count."""

from __future__ import annotations

from collections.abc import Iterator

import bpy


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
