"""Everything that Blender is told of: classes, ``scene.cvdgs``, pictures, jobs, and what follows an opened file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import bpy

from .. import operators, ui
from . import preferences_panel, properties
from .activity import ACTIVITY
from .compositor.copied_scenes import CopiedScenes
from .inspection import catch_up
from .pictures import PICTURES
from .scene.apart import Followers, remove_left_over
from .scene.camera_view import has_graphics_card, leave_slow_views
from .scene.display import Form, form_of, match_after_change, match_before_render, match_brought, match_linked
from .scene.masks import hide_again
from .scene.origin import keep_appended_run, keep_open_runs, keep_runs
from .scene.preview import end_looking_around
from .scene.splats import is_splats
from .scene.turntable import restore_interrupted
from .shown import forget_deleted, show_layer_again, show_source_of_missing_layer
from .watching import WATCHER

_FILE_EVENTS = ("load_post", "undo_post", "redo_post")


class _Part(Protocol):
    def register(self) -> None: ...

    def unregister(self) -> None: ...


def register_all(parts: Sequence[_Part]) -> None:
    """Register `parts` in order; when one fails, those before it are taken back."""
    done: list[_Part] = []
    try:
        for part in parts:
            part.register()
            done.append(part)
    except Exception:
        unregister_all(done)
        raise


def unregister_all(parts: Sequence[_Part]) -> None:
    """Undo `register_all`."""
    for part in reversed(parts):
        part.unregister()


class _Class:
    """A class that Blender shows or stores."""

    def __init__(self, cls: type) -> None:
        self._cls = cls

    def register(self) -> None:
        bpy.utils.register_class(self._cls)

    def unregister(self) -> None:
        bpy.utils.unregister_class(self._cls)


class _SceneProperty:
    """Every scene's ``cvdgs``."""

    def register(self) -> None:
        bpy.types.Scene.cvdgs = bpy.props.PointerProperty(type=properties.SceneProperties)

    def unregister(self) -> None:
        del bpy.types.Scene.cvdgs


class _Handler:
    """A persistent function that Blender calls at an event."""

    def __init__(self, event: str, function: Callable[..., None]) -> None:
        self._event, self._function = event, function

    def register(self) -> None:
        getattr(bpy.app.handlers, self._event).append(self._function)

    def unregister(self) -> None:
        handlers = getattr(bpy.app.handlers, self._event)
        if self._function in handlers:
            handlers.remove(self._function)


class _OpenedFiles:
    """Files that are opened or changed by undo: what was under way when they were written is put right again."""

    def register(self) -> None:
        for event in _FILE_EVENTS:
            getattr(bpy.app.handlers, event).append(_put_right)
        bpy.app.handlers.load_post.append(_show_colors)

    def unregister(self) -> None:
        for event in _FILE_EVENTS:
            handlers = getattr(bpy.app.handlers, event)
            if _put_right in handlers:
                handlers.remove(_put_right)
        if _show_colors in bpy.app.handlers.load_post:
            bpy.app.handlers.load_post.remove(_show_colors)


@bpy.app.handlers.persistent
def _put_right(*_: object) -> None:
    for scene in bpy.data.scenes:
        restore_interrupted(scene)
    for splats in filter(is_splats, bpy.data.objects):
        if splats.library is None:
            show_source_of_missing_layer(splats)
    if not bpy.app.background:  # nobody looks, and nobody would hear the worker's answer
        for window in bpy.context.window_manager.windows:
            leave_slow_views(window.scene)
            catch_up(window.scene)
        WATCHER.look_again()


@bpy.app.handlers.persistent
def _show_layers_again(*_: object) -> None:
    for splats in filter(is_splats, bpy.data.objects):
        if splats.library is None:
            show_layer_again(splats)


@bpy.app.handlers.persistent
def _show_colors(*_: object) -> None:
    """A file that opens shows its Gaussians in colour at once, on whatever machine."""
    if has_graphics_card():  # it draws all of them, also of a file that was saved while somebody looked around without
        for scene in bpy.data.scenes:
            end_looking_around(scene)
    if bpy.app.background:
        return
    for window in bpy.context.window_manager.windows:
        forms = {form_of(found) for found in window.scene.objects if is_splats(found)}
        # With a graphics card what was saved is right, unless it was saved without one.
        if window.scene.cvdgs.display.automatic and (Form.PREVIEW in forms or (forms and not has_graphics_card())):
            WATCHER.show(window.scene, closer=False)


@bpy.app.handlers.persistent
def _prepare_saving(path: str, *_: object) -> None:
    keep_runs(path)
    forget_deleted()
    remove_left_over()


@bpy.app.handlers.persistent
def _end_saving(path: str, *_: object) -> None:
    keep_open_runs(path)


@bpy.app.handlers.persistent
def _take_in(context: bpy.types.BlendImportContext, *_: object) -> None:
    """What was linked or appended keeps its run, and suits the scene that it is in."""
    brought = [item for item in context.import_items if isinstance(item.id, bpy.types.Object)]
    for item in brought:
        keep_appended_run(item.id, item.source_library)
    match_brought(item.id for item in brought)


PARTS: tuple[_Part, ...] = (
    *map(_Class, preferences_panel.CLASSES),
    PICTURES,
    *map(_Class, properties.CLASSES),
    _SceneProperty(),
    ACTIVITY,  # before what starts jobs for a file that was opened: it ends those of the file before
    _OpenedFiles(),
    _Handler("save_pre", _prepare_saving),
    _Handler("save_post", _end_saving),
    _Handler("save_post_fail", _end_saving),
    _Handler("blend_import_post", _take_in),
    _Handler("load_post", match_linked),
    _Handler("depsgraph_update_post", match_after_change),
    _Handler("frame_change_post", match_after_change),  # the only event where a window changes to another scene
    _Handler("render_init", match_before_render),
    _Handler("depsgraph_update_post", hide_again),
    _Handler("redo_post", _show_layers_again),
    CopiedScenes(),
    Followers(),
    WATCHER,
    *map(_Class, operators.CLASSES),
    *map(_Class, ui.CLASSES),
)
"""In the order in which they need each other."""
