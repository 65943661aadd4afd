"""Where the camera's frame lies in a 3D view that looks through it."""

from __future__ import annotations

import math

import bpy

_SHARE = 0.96  # of the free place that the frame takes
_ZOOM_STEP = 50.0  # Blender: the frame's share of the view's width is (sqrt(2) + zoom / 50)^2 / 4


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
