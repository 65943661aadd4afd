"""Pictures through a scene's compositor, for tests: an array in, the pixels of the written EXR out."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from cvdgs.cvdgs_addon.compositor.scene_tree import ensure_tree, output_socket

Pixels = NDArray[np.float32]


def random_picture(width: int = 32, height: int = 24, seed: int = 0) -> Pixels:
    """(H, W, 4) opaque values in [0, 1]."""
    picture = np.random.default_rng(seed).random((height, width, 4), np.float32)
    picture[..., 3] = 1.0
    return picture


def feed_picture(scene: bpy.types.Scene, picture: Pixels) -> bpy.types.Node:
    """Let the compositor's output show `picture`, (H, W, 4), as it is; returns the image node."""
    height, width, _ = picture.shape
    image = bpy.data.images.new("picture", width, height, alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    image.pixels.foreach_set(np.ascontiguousarray(picture[::-1]).ravel())
    tree = ensure_tree(scene)
    node = tree.nodes.new("CompositorNodeImage")
    node.image = image
    tree.links.new(node.outputs["Image"], output_socket(tree))
    render = scene.render
    render.engine = "BLENDER_WORKBENCH"
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    return node


def composited(scene: bpy.types.Scene, folder: Path) -> Pixels:
    """(H, W, 4) pixels of what the compositor makes, before the view transform."""
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    scene.render.engine = "CYCLES"  # with EEVEE, Blender aborts where there is no OpenGL
    scene.render.filepath = str(folder / "composited.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath, check_existing=False)
    image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
    pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1]
