"""Files that are opened or taken back by undo: what was under way when they were written is put right again."""

from __future__ import annotations

import bpy

from .inspection import catch_up
from .scene.camera_view import leave_slow_views
from .scene.turntable import restore_interrupted

_EVENTS = ("load_post", "undo_post", "redo_post")


@bpy.app.handlers.persistent
def _put_right(*_: object) -> None:
    for scene in bpy.data.scenes:
        restore_interrupted(scene)
    if not bpy.app.background:  # nobody looks, and nobody would hear the worker's answer
        for window in bpy.context.window_manager.windows:
            leave_slow_views(window.scene)
            catch_up(window.scene)


def register() -> None:
    """Look at every file that is opened, and at what undo and redo make of it."""
    for event in _EVENTS:
        getattr(bpy.app.handlers, event).append(_put_right)


def unregister() -> None:
    """Undo `register`."""
    for event in _EVENTS:
        handlers = getattr(bpy.app.handlers, event)
        if _put_right in handlers:
            handlers.remove(_put_right)
