"""How Gaussians are displayed: as instances, points or native splats, with what renders need."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum

import bpy
import numpy as np

from ...core.color import srgb
from ...core.errors import InputError
from .apart import follows_another
from .native_splats import add_native_splats, has_native_splats, native_splats_of, why_not_native
from .remembered_settings import Setting, change_settings, changes, restore_settings
from .render_settings import (
    WORLD_NAME,
    Display,
    Engine,
    background_world,
    display_of,
    display_settings,
    engine_settings,
)
from .sparse_points import is_sparse_points, show_as_light
from .splat_nodes import Input
from .splats import MODIFIER_NAME, get_input, has_input, is_splats, set_input

BACKGROUND_PROPERTY = "cvdgs_background"
"""Custom property of a Gaussians' object: sRGB of what they were trained over."""

_RENDER = "cvdgs_render"
_SHOWN = "cvdgs_shown_as"  # custom property of a scene: the `Display` of its Gaussians; "" once another one set theirs


class Form(Enum):
    """What Gaussians are drawn as."""

    PREVIEW = "PREVIEW"
    INSTANCES = "INSTANCES"
    POINTS = "POINTS"
    NATIVE = "NATIVE"


def form_of(splats: bpy.types.Object) -> Form:
    """What `splats` are drawn as."""
    if native_splats_of(splats) is not None:
        return Form.NATIVE
    if get_input(splats, Input.PREVIEW):
        return Form.PREVIEW
    return Form.POINTS if get_input(splats, Input.AS_POINTS) else Form.INSTANCES


def show_form(splats: bpy.types.Object, form: Form) -> None:
    """Draw `splats` as `form`. Native splats are a copy of what is shown now; choose the form again to renew it.

    Raises:
        InputError: this Blender has no native splats.
    """
    if form is Form.NATIVE and not has_native_splats():
        raise InputError(why_not_native(), where=splats.name, remedy="choose Instances, which look the same")
    existing = native_splats_of(splats)
    if existing is not None:
        bpy.data.pointclouds.remove(existing.data)
    modifier = splats.modifiers[MODIFIER_NAME]
    modifier.show_viewport = modifier.show_render = form is not Form.NATIVE
    if form is Form.NATIVE:
        add_native_splats(splats)
    else:
        set_input(splats, Input.PREVIEW, form is Form.PREVIEW)
        set_input(splats, Input.AS_POINTS, form is Form.POINTS)


def compare_colors(scene: bpy.types.Scene, border: float | None) -> None:
    """Let renders and 3D views show the original colours left of a border in the active camera's picture.

    Args:
        scene: whose Gaussians.
        border: as a fraction of the picture's width; None: no comparison any more.
    """
    for splats in filter(can_compare, scene.objects):
        set_input(splats, Input.COMPARE, border is not None)
        if border is not None:
            set_input(splats, Input.BORDER, border)


def can_compare(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is an object of Gaussians that can show two colours side by side."""
    return is_splats(candidate) and has_input(candidate, Input.COMPARE)


def set_up_render(
    scene: bpy.types.Scene, engine: Engine, display: Display, more: Mapping[str, Setting] | None = None
) -> list[str]:
    """Set what renders of Gaussians need, and remember what it was; returns the changes in words.

    Args:
        scene: whose renders.
        engine, display: that they are to have.
        more: further settings by path from the scene, to be put back with the others.
    """
    settings = {**display_settings(display), **engine_settings(engine, display), **(more or {})}
    background = _background_of(_splats_of(scene))
    if background is not None:
        color = np.array(background) if display is Display.PHOTO else srgb.decode(background)
        settings["world"] = _shared_world(color).name
        settings["render.film_transparent"] = False
    told = change_settings(scene, _RENDER, settings)
    match_display(scene)
    return told


def restore_render(scene: bpy.types.Scene) -> list[str]:
    """Put back what `set_up_render` changed; returns that in words."""
    told = restore_settings(scene, _RENDER)
    match_display(scene)
    return told


def render_changes(scene: bpy.types.Scene) -> Iterator[str]:
    """What `restore_render` would put back, in words."""
    return changes(scene, _RENDER)


def match_display(scene: bpy.types.Scene) -> None:
    """Let the Gaussians' colours suit the scene's view transform: encoded for Raw, light for the others."""
    shown = display_of(scene)
    is_light = shown is Display.SCENE_LINEAR
    for candidate in _shown_in(scene):
        if is_splats(candidate):
            set_input(candidate, Input.SCENE_LINEAR, is_light)
        elif is_sparse_points(candidate):
            show_as_light(candidate, is_light)
        else:
            continue
        for other in candidate.users_scene:
            if other.get(_SHOWN) != shown.value:
                other[_SHOWN] = ""
    scene[_SHOWN] = shown.value


def match_brought(brought: Iterable[bpy.types.Object]) -> None:
    """Let what came from other files, whose view transforms may be others, suit the scenes that have it now."""
    ours = {found for found in brought if is_splats(found) or is_sparse_points(found)}
    for scene in bpy.data.scenes if ours else ():
        if scene.library is None and not follows_another(scene) and not ours.isdisjoint(_shown_in(scene)):
            match_display(scene)


@bpy.app.handlers.persistent
def match_linked(*_: object) -> None:
    """Do the same where a file opens: it does not keep what was set for linked objects."""
    match_brought(found for found in bpy.data.objects if found.library is not None)


@bpy.app.handlers.persistent
def match_before_render(scene: bpy.types.Scene, *_: object) -> None:
    """Match the Gaussians of `scene` where its view transform was changed, or another scene's that shows them too.

    What somebody chose for them by hand stays until then. Renders that a window starts come here on a thread of theirs.
    """
    before = scene.get(_SHOWN)
    is_left_behind = before is not None and before != display_of(scene).value
    if is_left_behind and threading.current_thread() is threading.main_thread():
        match_display(scene)


@bpy.app.handlers.persistent
def match_after_change(scene: bpy.types.Scene, *_: object) -> None:
    """Do the same at once; but two windows that show the same Gaussians in two ways would take turns for ever."""
    is_alone = all(window.scene == scene for window in bpy.context.window_manager.windows)
    if is_alone or scene.get(_SHOWN):
        match_before_render(scene)


def _shown_in(scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """The objects of `scene`, and those of collections that it has as instances, such as *Link* makes."""
    yield from scene.objects
    for collection in {found.instance_collection for found in scene.objects if found.instance_collection}:
        yield from collection.all_objects


def _splats_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    return [candidate for candidate in scene.objects if is_splats(candidate)]


def _background_of(objects: Iterable[bpy.types.Object]) -> tuple[float, ...] | None:
    found = (splats.get(BACKGROUND_PROPERTY) for splats in objects)
    return next((tuple(color) for color in found if color is not None), None)


def _shared_world(color: np.ndarray) -> bpy.types.World:
    """A world of that colour, made when the file has none of ours."""
    existing = [world for world in bpy.data.worlds if world.name.startswith(WORLD_NAME) and world.node_tree]
    for world in existing:
        background = next((node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground"), None)
        if background is not None and np.allclose(background.inputs["Color"].default_value[:3], color, atol=1e-6):
            return world
    return background_world(color)
