"""A 3D view that shows rendered Gaussians through a camera: in their colours, without a graphics card too."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import bpy
import gpu
import mathutils

from ...core.errors import InputError
from .cameras import camera_settings, is_capture_camera
from .display import set_up_render
from .remembered_settings import Setting
from .render_settings import Display, Engine
from .splat_nodes import Input
from .splats import is_splats, set_input
from .turntable import turntable_of
from .world_matrix import scale_of, world_of

_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swiftshader")
_SHARE = 0.96  # of the free place that the frame takes
_ZOOM_STEP = 50.0  # Blender: the frame's share of the view's width is (sqrt(2) + zoom / 50)^2 / 4
_PAST_FRAME = 1.1  # of the distance from a camera to the frame that Blender draws for it
_WHOLE_FRAME: dict[str, Setting] = {  # nothing is drawn outside the camera's frame
    "render.use_border": True,
    **{f"render.border_{end}_{axis}": side for end, side in (("min", 0.0), ("max", 1.0)) for axis in "xy"},
}
_PIXEL = "2"  # of the 3D view, in pixels of the screen: a quarter of the work


def has_graphics_card() -> bool:
    """Whether a graphics card draws the 3D views; without a window nothing does."""
    if bpy.app.background:
        return False
    return not any(name in gpu.platform.renderer_get().lower() for name in _SOFTWARE_RENDERERS)


def smooths_slowly(context: bpy.types.Context) -> bool:
    """Whether the processor draws the 3D views, and spends a third of each redraw on smooth edges."""
    is_software = not bpy.app.background and not has_graphics_card()
    return is_software and context.preferences.system.viewport_aa != "OFF"


def views_3d() -> Iterator[bpy.types.SpaceView3D]:
    """The 3D views of all windows."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield area.spaces.active


def fit_camera_frame(area: bpy.types.Area, scene: bpy.types.Scene) -> None:
    """Put the frame of a camera whose sensor fit is horizontal where no side bar or header of `area` covers it."""
    view = next(region for region in area.regions if region.type == "WINDOW")
    if min(view.width, view.height) <= 1:
        return  # never drawn
    left, right, low, high = _free_place(area, view)
    render = scene.render
    height_to_width = render.resolution_y * render.pixel_aspect_y / (render.resolution_x * render.pixel_aspect_x)
    share = _SHARE * min(right - left, (high - low) / height_to_width) / view.width
    space = area.spaces.active.region_3d
    space.view_camera_zoom = _ZOOM_STEP * (2.0 * math.sqrt(share) - math.sqrt(2.0))
    # Blender counts the offset in twice the frame's width, and in the other direction.
    space.view_camera_offset = (
        (0.5 * view.width - 0.5 * (left + right)) / (2.0 * share * view.width),
        (0.5 * view.height - 0.5 * (low + high)) / (2.0 * share * view.height),
    )


def _free_place(area: bpy.types.Area, view: bpy.types.Region) -> tuple[float, float, float, float]:
    """Left, right, lower and upper end of the largest place in `view` that no other region lies over, in pixels."""
    left, right, low, high = 0.0, float(view.width), 0.0, float(view.height)
    for region in area.regions:
        if region.type not in ("UI", "TOOLS", "HEADER", "TOOL_HEADER") or min(region.width, region.height) <= 1:
            continue
        x, y = region.x - view.x, region.y - view.y
        if region.type == "TOOLS":
            left = max(left, x + region.width)
        elif region.type == "UI":
            right = min(right, x)
        elif y > view.height / 2:
            high = min(high, y)
        else:
            low = max(low, y + region.height)
    return left, right, low, high


def view_in_color(
    scene: bpy.types.Scene,
    area: bpy.types.Area,
    engine: Engine,
    display: Display,
    *,
    coarse: bool,
) -> list[str]:
    """Let the 3D view in `area` look through a camera at the rendered Gaussians; returns what changed, in words.

    The camera is the scene's, where that is a photograph's or the turntable's, else one of these; a photograph's
    brings its size along. `display.restore_render` puts the settings back.

    Args:
        coarse: in larger pixels, for a machine without a graphics card.

    Raises:
        InputError: the scene has no such camera, or this Blender does not offer what is needed; nothing changes then.
    """
    settings = _suitable_camera(scene)
    if coarse:
        settings["render.preview_pixel_size"] = _PIXEL
    if engine is Engine.CYCLES and not scene.render.use_border:  # a region that was drawn before stays, out of use
        settings |= _WHOLE_FRAME
    told = set_up_render(scene, engine, display, settings)
    if engine is Engine.CYCLES:
        for drawn in filter(is_splats, scene.objects):  # each run's: what was left as ellipsoids would take minutes
            set_input(drawn, Input.CAMERA_VIEW, True)
    space = area.spaces.active
    space.region_3d.view_perspective = "CAMERA"
    fit_camera_frame(area, scene)
    space.shading.type = "RENDERED"
    return told


def middle_camera(objects: Iterable[bpy.types.Object]) -> bpy.types.Object | None:
    """The photograph's camera from the middle of a walk past a subject, which stands before it; None without any."""
    photographs = list(filter(is_capture_camera, objects))
    return photographs[len(photographs) // 2] if photographs else None


def stand_at(space: bpy.types.SpaceView3D, camera: bpy.types.Object, target: mathutils.Vector) -> None:
    """Let a view look from where `camera` is, free to orbit around what lies before it as far away as `target`.

    It stands before the frame that Blender draws for the camera, which would be lines across the picture.
    """
    matrix = world_of(camera)
    turn = matrix.to_quaternion()
    look = turn @ mathutils.Vector((0.0, 0.0, -1.0))
    frame = 2.0 * camera.data.display_size * camera.data.lens / camera.data.sensor_width  # as far before the camera
    eye = matrix.translation + _PAST_FRAME * frame * scale_of(matrix) * look
    distance = max((target - eye).dot(look), camera.data.clip_start)
    view = space.region_3d
    view.view_perspective = "PERSP"
    view.view_rotation = turn
    view.view_distance, view.view_location = distance, eye + distance * look


def leave_slow_views(scene: bpy.types.Scene) -> None:
    """Show no 3D view as rendered any more where Blender would stand still: Gaussians in EEVEE without a graphics card.

    For whatever brings another engine back; what a view shows is neither a render setting nor part of undo.
    """
    if has_graphics_card() or scene.render.engine == "CYCLES" or not any(map(is_splats, scene.objects)):
        return
    for view in views_3d():
        if view.shading.type == "RENDERED":
            view.shading.type = "SOLID"


def _suitable_camera(scene: bpy.types.Scene) -> dict[str, Setting]:
    """What `scene` needs to look through a photograph's or the turntable's camera; nothing where it does."""
    turntable = turntable_of(scene)
    if scene.camera is not None and (scene.camera == turntable or is_capture_camera(scene.camera)):
        return {}
    if turntable is not None:
        return {"camera": turntable.name}
    photograph = middle_camera(scene.objects)
    if photograph is None:
        raise InputError("no camera looks at the Gaussians", where=scene.name, remedy="add a turntable first")
    return camera_settings(photograph)
