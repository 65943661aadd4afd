"""A 3D view that shows rendered Gaussians through a camera: in their colours, without a graphics card too."""

from __future__ import annotations

import bpy

from ...core.errors import InputError
from ..graphics import has_graphics_card, views_3d
from .camera_frame import fit_camera_frame
from .cameras import is_capture_camera, use_camera
from .display import set_up_render
from .remembered_settings import Setting
from .render_settings import Display, Engine
from .splat_nodes import Input
from .splats import is_splats, set_input
from .turntable import turntable_of

_PIXEL = "2"  # of the 3D view, in pixels of the screen: a quarter of the work


def view_in_color(
    scene: bpy.types.Scene,
    area: bpy.types.Area,
    splats: bpy.types.Object,
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
        InputError: the scene has no such camera.
    """
    _use_suitable_camera(scene)
    settings: dict[str, Setting] = {"render.preview_pixel_size": _PIXEL} if coarse else {}
    if engine is Engine.CYCLES:
        settings["render.use_border"] = True  # nothing is drawn outside the camera's frame
        set_input(splats, Input.CAMERA_VIEW, True)
    told = set_up_render(scene, engine, display, settings)
    space = area.spaces.active
    space.region_3d.view_perspective = "CAMERA"
    fit_camera_frame(area, scene)
    space.overlay.show_relationship_lines = False  # from each photograph's camera, across the picture
    space.shading.type = "RENDERED"
    return told


def leave_slow_views(scene: bpy.types.Scene) -> None:
    """Show no 3D view as rendered any more where Blender would stand still: Gaussians in EEVEE without a graphics card.

    For whatever brings another engine back; what a view shows is neither a render setting nor part of undo.
    """
    if has_graphics_card() or scene.render.engine == "CYCLES" or not any(map(is_splats, scene.objects)):
        return
    for view in views_3d():
        if view.shading.type == "RENDERED":
            view.shading.type = "SOLID"


def _use_suitable_camera(scene: bpy.types.Scene) -> None:
    turntable = turntable_of(scene)
    if scene.camera is not None and (scene.camera == turntable or is_capture_camera(scene.camera)):
        return
    photographs = [candidate for candidate in scene.objects if is_capture_camera(candidate)]
    if turntable is not None:
        scene.camera = turntable
    elif photographs:
        use_camera(scene, photographs[len(photographs) // 2])  # whoever walks past a subject stands before it midway
    else:
        raise InputError("no camera looks at the Gaussians", where=scene.name, remedy="add a turntable first")
