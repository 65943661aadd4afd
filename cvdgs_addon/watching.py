"""Follows the 3D views: the preview while somebody works or orbits, the rendered scene once nothing else goes on.

Blender tells nobody that a view was turned or shaded in another way, so a timer looks.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import bpy
import mathutils

from ..core.errors import InputError
from ..core.splats.gaussians import core_bounds
from .activity import ACTIVITY, redraw_panels, remember_for_undo, scene_by_uid
from .compositor.apply import simulation_lifted
from .scene.bystanders import bystanders
from .scene.camera_view import has_graphics_card, middle_camera, stand_at, view_in_color
from .scene.display import Form, form_of
from .scene.preview import end_looking_around, follow_shading, shade_flat, show_in_color
from .scene.render_settings import Display, Engine
from .scene.splat_attributes import point_positions
from .scene.splats import is_splats
from .scene.world_matrix import world_of

_INTERVAL = 0.1  # seconds between looks at the views
_QUIET = 2.5  # seconds in which nothing happened, after which the scene is rendered


class ViewWatcher:
    """The timer, and what it saw last."""

    def __init__(self) -> None:
        self._seen: tuple = ()
        self._counted: dict[int, tuple[int, bool]] = {}  # by scene: how many objects, and whether any are Gaussians
        self._awaited: tuple[int, float, tuple] | None = None  # scene, since when nothing happened, and what was seen
        self._timer = self.look

    def register(self) -> None:
        if not bpy.app.background:
            bpy.app.timers.register(self._timer, first_interval=_INTERVAL, persistent=True)

    def unregister(self) -> None:
        self._awaited = None
        if bpy.app.timers.is_registered(self._timer):
            bpy.app.timers.unregister(self._timer)

    def show(self, scene: bpy.types.Scene, *, closer: bool) -> None:
        """Show the Gaussians of `scene` in colour at once; `closer`: from inside, and rendered once all is quiet."""
        show_in_color(scene)
        if closer and not bystanders(scene):
            _stand_in(scene)
        wants = closer and scene.cvdgs.display.automatic and not has_graphics_card()
        self._awaited = (scene.session_uid, time.monotonic(), ()) if wants else None

    def look_again(self) -> None:
        """Follow the views anew at the next look: undo brings forms back, but not what views show."""
        self._seen = ()

    def look(self) -> float:
        """One look at the views; for the timer."""
        views = tuple(_views())
        for scene in {window.scene for window, _, _ in views}:
            if self._has_first_gaussians(scene) and scene.cvdgs.display.automatic:
                show_in_color(scene)
        state = tuple(
            (space.as_pointer(), space.shading.type, space.region_3d.view_perspective, window.scene.render.engine)
            for window, _, space in views
        )
        if state != self._seen:
            self._follow(views)
            self._seen = state
        if self._awaited is not None:
            self._look_closer(views)
        return _INTERVAL

    def _has_first_gaussians(self, scene: bpy.types.Scene) -> bool:
        """Whether Gaussians came into a scene that had none at the last look: linked or appended by hand."""
        count = len(scene.objects)
        before = self._counted.get(scene.session_uid)
        if before is not None and before[0] == count:
            return False
        has_any = any(map(is_splats, scene.objects))
        self._counted[scene.session_uid] = (count, has_any)
        return before is not None and has_any and not before[1]

    def _follow(self, views: tuple) -> None:
        for scene in {window.scene for window, _, _ in views}:
            mine = [space for window, _, space in views if window.scene == scene]
            if not scene.cvdgs.display.automatic or not any(map(is_splats, scene.objects)):
                continue
            for space in mine:
                if space.shading.type == "RENDERED" and _has_left_its_camera(space, scene):
                    shade_flat(space)
            follow_shading(scene, mine)

    def _look_closer(self, views: tuple) -> None:
        assert self._awaited is not None
        uid, since, before = self._awaited
        scene = scene_by_uid(uid)
        mine = [(area, space) for window, area, space in views if window.scene == scene]
        now = (bpy.context.mode, *(tuple(map(tuple, space.region_3d.view_matrix)) for _, space in mine))
        if scene is None or not mine or any(space.shading.type != "SOLID" for _, space in mine):
            self._awaited = None  # somebody has chosen something else
            return
        busy = ACTIVITY.is_busy() or bpy.app.is_job_running("RENDER") or any(
            window.modal_operators for window in bpy.context.window_manager.windows
        )  # fmt: skip
        if busy or now != before:
            if before and now != before:
                self._awaited = None  # who orbits wants the preview
            else:
                self._awaited = (uid, time.monotonic(), now)
        elif time.monotonic() - since > _QUIET:
            self._awaited = None
            if bpy.context.mode == "OBJECT" and not bystanders(scene):
                _render(scene, max(mine, key=lambda found: found[0].width * found[0].height)[0])


WATCHER = ViewWatcher()


def _views() -> Iterator[tuple[bpy.types.Window, bpy.types.Area, bpy.types.SpaceView3D]]:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield window, area, area.spaces.active


def _has_left_its_camera(space: bpy.types.SpaceView3D, scene: bpy.types.Scene) -> bool:
    """Whether a view that looked through a camera shows discs from where they are wrong, at a redraw of seconds."""
    return (
        not has_graphics_card()
        and scene.render.engine == "CYCLES"
        and space.region_3d.view_perspective != "CAMERA"
        and any(is_splats(found) and form_of(found) is Form.INSTANCES for found in scene.objects)
    )


def _stand_in(scene: bpy.types.Scene) -> None:
    """Look from where a photographer stood: from outside, the back of a wall hides a room."""
    splats = scene.cvdgs.display.target
    if splats is None or splats.parent is None:
        return
    bpy.context.view_layer.update()  # the places of what was just added
    camera, positions = middle_camera(splats.parent.children), point_positions(splats.data)
    if camera is None or not len(positions):
        return
    target = world_of(splats) @ mathutils.Vector(core_bounds(positions)[0].tolist())
    for window, _, space in _views():
        if window.scene == scene and space.region_3d.view_perspective == "PERSP":
            stand_at(space, camera, target)


def _render(scene: bpy.types.Scene, area: bpy.types.Area) -> None:
    splats = scene.cvdgs.display.target
    if splats is None or splats.name not in scene.objects:
        return
    chosen = scene.cvdgs.display
    try:
        with simulation_lifted(scene):
            view_in_color(scene, area, Engine.CYCLES, Display[chosen.colors], coarse=True)
    except InputError:  # no camera looks at them: the preview stays
        return
    end_looking_around(scene)
    remember_for_undo("View in Colour")
    redraw_panels()
