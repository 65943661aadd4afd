"""What draws Blender's 3D views: a graphics card, or the processor in its place."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import gpu

_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swiftshader")


def has_graphics_card() -> bool:
    """Whether a graphics card draws the 3D views; without a window nothing does."""
    if bpy.app.background:
        return False
    return not any(name in gpu.platform.renderer_get().lower() for name in _SOFTWARE_RENDERERS)


def views_3d() -> Iterator[bpy.types.SpaceView3D]:
    """The 3D views of all windows."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield area.spaces.active
