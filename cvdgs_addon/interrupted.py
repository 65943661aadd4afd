"""Files that were saved while a turntable rendered: the scene's own settings come back when they are opened."""

from __future__ import annotations

import bpy

from .scene.turntable import restore_interrupted


@bpy.app.handlers.persistent
def _after_load(*_: object) -> None:
    for scene in bpy.data.scenes:
        restore_interrupted(scene)


def register() -> None:
    """Look at every file that is opened."""
    bpy.app.handlers.load_post.append(_after_load)


def unregister() -> None:
    """Undo `register`."""
    if _after_load in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.remove(_after_load)
