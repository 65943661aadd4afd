"""Stills of a scene with Gaussians, rendered to PNG files that appear only when they are complete."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import mathutils

from ...core.files.untrusted import replacing
from .cameras import use_camera
from .render_settings import literal_path, set_png

_LEAST_FREE = 4 << 20  # bytes; with less, there is no room for a picture or a scene


def render_still(scene: bpy.types.Scene, camera: bpy.types.Object, path: Path) -> None:
    """Render `scene` through a capture's camera, at its own size, into the PNG file `path`.

    Raises:
        OSError: the file cannot be written.
        RuntimeError: Blender could not render.
    """
    use_camera(scene, camera)
    set_png(scene)
    render_picture(scene, path)


def render_picture(scene: bpy.types.Scene, path: Path) -> None:
    """Render `scene` as it is set up, to PNG, into `path`; raises as `render_still` does."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with replacing(path) as temporary:
            scene.render.filepath = literal_path(temporary)
            bpy.ops.render.render(write_still=True, scene=scene.name)
    finally:
        scene.render.filepath = "//renders/"


@contextmanager
def turned_to(camera: bpy.types.Object, *roots: bpy.types.Object) -> Iterator[None]:
    """Within the block, `roots` and all below them stand so that `camera`, one of them, looks down -Z from the origin.

    The picture is the same, but the discs of Gaussians that face the camera then have flat bounding boxes, and Cycles
    finds the next one on a ray sooner: a still takes half the time with discs as instances, and four fifths with discs
    as one mesh (see `drawing_nodes`). Only for scenes that have nothing outside of `roots`.
    """
    turn = bpy.data.objects.new("Turn", None)
    bpy.context.view_layer.update()
    location, rotation, _ = camera.matrix_world.decompose()
    turn.matrix_basis = mathutils.Matrix.LocRotScale(location, rotation, None).inverted()
    for root in roots:
        root.parent = turn
    try:
        yield
    finally:
        for root in roots:
            root.parent = None
        bpy.data.objects.remove(turn)


def is_full(folder: Path) -> bool:
    """Whether the disk that holds `folder` has no room left."""
    return shutil.disk_usage(folder).free <= _LEAST_FREE
