"""Stills of a scene with Gaussians, rendered to PNG files that appear only when they are complete."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from .cameras import use_camera
from .render_settings import set_png
from .splats import show_layer


def render_still(scene: bpy.types.Scene, camera: bpy.types.Object, path: Path) -> None:
    """Render `scene` through a capture's camera, at its own size, into the PNG file `path`.

    Raises:
        OSError: the file cannot be written.
        RuntimeError: Blender could not render.
    """
    use_camera(scene, camera)
    set_png(scene)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.partial.png")
    scene.render.filepath = str(temporary)
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
        scene.render.filepath = "//renders/"


def render_layer_still(
    scene: bpy.types.Scene, splats: bpy.types.Object, layer: str, camera: bpy.types.Object, path: Path
) -> None:
    """Render one colour layer of `splats`; see `render_still`."""
    show_layer(splats, layer)
    render_still(scene, camera, path)
