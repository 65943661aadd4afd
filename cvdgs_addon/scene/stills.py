"""Stills of a scene with Gaussians, rendered to PNG files that appear only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import mathutils

from .cameras import use_camera
from .render_settings import set_png


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


@contextmanager
def turned_to(camera: bpy.types.Object, root: bpy.types.Object) -> Iterator[None]:
    """Within the block, `root` and all below it stand so that `camera`, one of them, looks down -Z from the origin.

    The picture is the same, but the discs of Gaussians that face the camera then have flat bounding boxes, and Cycles
    finds the next one on a ray in half the time. Only for scenes that have nothing outside of `root`.
    """
    turn = bpy.data.objects.new("Turn", None)
    bpy.context.view_layer.update()
    location, rotation, _ = camera.matrix_world.decompose()
    turn.matrix_basis = mathutils.Matrix.LocRotScale(location, rotation, None).inverted()
    root.parent = turn
    try:
        yield
    finally:
        root.parent = None
        bpy.data.objects.remove(turn)
