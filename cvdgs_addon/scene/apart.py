"""An artist's objects and the Gaussians, each in a scene of its own that follows the artist's: both get what they need.

Objects need many samples, bounces, a denoiser and a soft pixel filter; Gaussians need one sample at the pixel's centre,
and denoisers take their weave for noise. In the Gaussians' scene the objects are holes, so that what stands before them
hides them. `compositor.apart` puts the pictures together. 3D views show the artist's own scene.
"""

from __future__ import annotations

import importlib
import threading
from collections.abc import Iterable, Iterator

import bpy

from .bystanders import is_instance_of_gaussians, surfaces
from .catcher import catchers_of, is_catcher_handle, keep_catchers
from .native_splats import is_native_splats
from .render_settings import Engine, engine_settings
from .sparse_points import is_sparse_points
from .splats import is_splats
from .view_layers import empty_layers, rendered_objects, tick_layers_again, untick_layers

OBJECTS_LAYER, COVERAGE_LAYER, GAUSSIANS_LAYER = "Objects", "Coverage", "Gaussians"
"""View layers: lit objects with the shadows that they throw; where objects are, as alpha; Gaussians with holes."""

_OBJECTS_SCENE, _GAUSSIANS_SCENE = "cvdgs_objects_scene", "cvdgs_gaussians_scene"
_OWNER = "cvdgs_owner"  # custom property of these two: the scene that they follow
_THINGS, _LAMPS, _CATCHERS, _SPLATS = "CVD Objects", "CVD Lamps", "CVD Shadow Catchers", "CVD Gaussians"
_FOLLOWED = (
    *("camera", "world", "cycles.device", "render.resolution_x", "render.resolution_y", "render.resolution_percentage"),
    *("render.pixel_aspect_x", "render.pixel_aspect_y", "render.use_motion_blur", "render.motion_blur_shutter"),
    *("render.use_border", "render.use_crop_to_border", "render.frame_map_old", "render.frame_map_new"),
    *(f"render.border_{end}_{axis}" for end in ("min", "max") for axis in "xy"),
)
_OF_OBJECTS = {
    "render.engine": "CYCLES",
    "render.film_transparent": True,
    "cycles.samples": 64,
    "cycles.use_adaptive_sampling": True,
    "cycles.adaptive_threshold": 0.02,
    "cycles.max_bounces": 4,
    "cycles.transparent_max_bounces": 32,
}
_COVERAGE_SAMPLES = 16
_INTERVAL = 0.1  # seconds between looks at the markers


def objects_scene(scene: bpy.types.Scene) -> bpy.types.Scene | None:
    """The scene that renders the objects of `scene`; None where they are rendered with the Gaussians."""
    return _own(scene, _OBJECTS_SCENE)


def gaussians_scene(scene: bpy.types.Scene) -> bpy.types.Scene | None:
    """The scene that renders the Gaussians of `scene` alone; None where there is none."""
    return _own(scene, _GAUSSIANS_SCENE)


def is_apart(scene: bpy.types.Scene) -> bool:
    """Whether the objects of `scene` are rendered apart from its Gaussians."""
    return objects_scene(scene) is not None and gaussians_scene(scene) is not None


def follows_another(scene: bpy.types.Scene) -> bool:
    """Whether `take_apart` made the scene, for another one."""
    return _OWNER in scene


def names_scenes_of_another(scene: bpy.types.Scene) -> bool:
    """Whether `scene` was copied from one that is rendered apart, and has no scenes of its own for that yet."""
    helpers = [scene.get(key) for key in (_OBJECTS_SCENE, _GAUSSIANS_SCENE)]
    return any(helper is not None and helper.get(_OWNER) != scene for helper in helpers)


def take_apart(scene: bpy.types.Scene) -> None:
    """Let objects and Gaussians of `scene` be rendered in scenes of their own; nothing of them is copied."""
    put_together(scene)
    things, lamps, catchers, splats = map(bpy.data.collections.new, (_THINGS, _LAMPS, _CATCHERS, _SPLATS))
    lit = _new_scene(f"{scene.name}, Objects", _OF_OBJECTS, things, lamps, catchers)
    lit.view_layers[0].name = OBJECTS_LAYER
    lit.view_layers[0].cycles.use_denoising = True
    lit.cycles.use_denoising = _has_denoiser()
    coverage = lit.view_layers.new(COVERAGE_LAYER)
    coverage.samples = _COVERAGE_SAMPLES
    coverage.cycles.use_denoising = False
    for collection in (lamps, catchers):
        coverage.layer_collection.children[collection.name].exclude = True
    shown = _new_scene(f"{scene.name}, Gaussians", engine_settings(Engine.CYCLES), splats, things)
    shown.view_layers[0].name = GAUSSIANS_LAYER
    shown.view_layers[0].layer_collection.children[things.name].holdout = True
    scene[_OBJECTS_SCENE], scene[_GAUSSIANS_SCENE] = lit, shown
    lit[_OWNER] = shown[_OWNER] = scene
    untick_layers(scene)
    follow(scene)


def put_together(scene: bpy.types.Scene) -> None:
    """Undo `take_apart`."""
    for handle in filter(is_catcher_handle, scene.objects):
        keep_catchers(handle)  # one of an earlier release has nothing else that does
    for key in (_OBJECTS_SCENE, _GAUSSIANS_SCENE):
        helper = _own(scene, key)
        if helper is not None:
            _remove(helper)
        scene.pop(key, None)
    tick_layers_again(scene)


def remove_left_over() -> None:
    """Remove the scenes of `take_apart` whose own scene was deleted, unless somebody has put something into them."""
    left_over = [found for found in bpy.data.scenes if follows_another(found) and found[_OWNER] is None]
    if len(left_over) == len(bpy.data.scenes) or bpy.app.is_job_running("RENDER"):
        return  # a file has one scene at least
    for helper in left_over:
        if helper.library is None and not helper.collection.objects:
            _remove(helper)


def follow(scene: bpy.types.Scene) -> None:
    """Bring the scenes of `take_apart` up to date: objects, cameras, world and size of `scene`."""
    lit, shown = objects_scene(scene), gaussians_scene(scene)
    if lit is None or shown is None:
        return
    for helper in (lit, shown):
        for path in _FOLLOWED:
            _copy(scene, helper, path)
    follow_markers(scene)
    things, lamps, catchers = lit.collection.children
    splats = shown.collection.children[0]
    rendered = rendered_objects(scene)
    changes = [
        _fill(things, (found for found in surfaces(scene) if found in rendered and not found.is_shadow_catcher)),
        _fill(lamps, (found for found in rendered if found.type == "LIGHT")),
        _fill(catchers, _catchers_among(scene, rendered)),
        _fill(splats, filter(_is_of_gaussians, rendered)),
    ]
    for empty in empty_layers(scene):
        for child in empty.layer_collection.children:
            if not child.exclude:
                child.exclude = True
    if any(changes):
        bpy.context.view_layer.update()  # a render that has begun may find view layers as they were, and crash


def follow_markers(scene: bpy.types.Scene) -> None:
    """Bind in the scenes of `take_apart` the cameras that markers of `scene` bind: each scene changes to its own.

    Markers are changed in place, since a render may be looking at them.
    """
    bound = [marker for marker in scene.timeline_markers if marker.camera is not None]
    for helper in filter(None, (objects_scene(scene), gaussians_scene(scene))):
        markers = helper.timeline_markers
        while len(markers) > len(bound):
            markers.remove(markers[-1])
        while len(markers) < len(bound):
            markers.new("")
        for marker, followed in zip(markers, bound, strict=True):
            if (marker.frame, marker.camera) != (followed.frame, followed.camera):
                marker.frame, marker.camera = followed.frame, followed.camera


class Followers:
    """Follows every change of scenes that are rendered apart; a part of the add-on."""

    def __init__(self) -> None:
        @bpy.app.handlers.persistent
        def follow_all(*_: object) -> None:
            # Renders that a window starts come here on a thread of theirs: what changed before was followed at once.
            if threading.current_thread() is threading.main_thread():
                for scene in filter(is_apart, list(bpy.data.scenes)):
                    follow(scene)

        self._follow, self._timer = follow_all, self.look
        self._events = ("depsgraph_update_post", "render_init", "load_post")

    def register(self) -> None:
        for event in self._events:
            getattr(bpy.app.handlers, event).append(self._follow)
        if not bpy.app.background:
            bpy.app.timers.register(self._timer, first_interval=_INTERVAL, persistent=True)

    def unregister(self) -> None:
        for event in self._events:
            handlers = getattr(bpy.app.handlers, event)
            if self._follow in handlers:
                handlers.remove(self._follow)
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)

    def look(self) -> float:
        """Follow the deletion of markers and scenes, of which Blender does not tell; for the timer."""
        remove_left_over()
        for scene in filter(is_apart, bpy.data.scenes):
            follow_markers(scene)
        return _INTERVAL


def _own(scene: bpy.types.Scene, key: str) -> bpy.types.Scene | None:
    """The scene that `scene` names and that follows it: a copy names those of the scene that it was copied from."""
    helper = scene.get(key)
    return helper if helper is not None and helper.get(_OWNER) == scene else None


def _remove(helper: bpy.types.Scene) -> None:
    for collection in list(helper.collection.children):
        bpy.data.collections.remove(collection)
    bpy.data.scenes.remove(helper)


def _new_scene(name: str, settings: dict, *collections: bpy.types.Collection) -> bpy.types.Scene:
    scene = bpy.data.scenes.new(name)
    for path, value in settings.items():
        _set(scene, path, value)
    for collection in collections:
        scene.collection.children.link(collection)
    scene.view_layers[0].update()  # Blender 5.2 knows the collections of a new scene only then
    return scene


def _has_denoiser() -> bool:
    """Whether this Blender was built with one that needs no graphics card: some distributions leave it out."""
    return bool(getattr(importlib.import_module("_cycles"), "with_openimagedenoise", False))


def _catchers_among(scene: bpy.types.Scene, rendered: set[bpy.types.Object]) -> Iterator[bpy.types.Object]:
    """What shows nothing but shadows: the planes of `catcher`, and what the artist made a shadow catcher of."""
    for handle in filter(is_catcher_handle, rendered):
        yield from catchers_of(handle)
    yield from (found for found in surfaces(scene) if found.is_shadow_catcher and found in rendered)


def _is_of_gaussians(candidate: bpy.types.Object) -> bool:
    return (
        is_splats(candidate)
        or is_sparse_points(candidate)
        or is_native_splats(candidate)
        or is_instance_of_gaussians(candidate)
    )


def _fill(collection: bpy.types.Collection, wanted: Iterable[bpy.types.Object]) -> bool:
    """Let `collection` hold the `wanted` objects; returns whether it did not."""
    wanted = set(wanted)
    present = set(collection.objects)
    for found in present - wanted:
        collection.objects.unlink(found)
    for found in wanted - present:
        collection.objects.link(found)
    return wanted != present


def _copy(source: bpy.types.Scene, target: bpy.types.Scene, path: str) -> None:
    value = source.path_resolve(path)
    if target.path_resolve(path) != value:
        _set(target, path, value)


def _set(scene: bpy.types.Scene, path: str, value: object) -> None:
    parent, _, name = path.rpartition(".")
    setattr(scene.path_resolve(parent) if parent else scene, name, value)
