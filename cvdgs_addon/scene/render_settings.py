"""Render settings that Gaussians need: what is seen are the photos' colours, without noise."""

from __future__ import annotations

from enum import Enum

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

# Each splat on a ray takes a bounce; where fewer are guaranteed, Russian roulette adds noise (18 dB instead of 49).
TRANSPARENT_BOUNCES = 512
# Blender's smallest pixel filter: the rasteriser, too, looks at the pixel's centre only. One sample is then enough.
FILTER_WIDTH = 0.01  # pixels

WORLD_NAME = "CVD Background"


class Display(Enum):
    """How trained colours, which are display-referred sRGB, get onto the screen."""

    PHOTO = "photo"
    """Splats are blended as trained, in encoded values, and shown unchanged (view transform Raw)."""

    SCENE_LINEAR = "scene-linear"
    """Splats are converted to light, blended as light, and shown through Standard: mixes with lit objects."""


def set_display(scene: bpy.types.Scene, display: Display) -> None:
    """Set the view transform of `scene`; the Gaussians' input "Scene Linear" has to agree."""
    scene.display_settings.display_device = "sRGB"
    view = scene.view_settings
    view.view_transform = "Raw" if display is Display.PHOTO else "Standard"
    view.look = "None"
    view.exposure, view.gamma = 0.0, 1.0
    view.use_curve_mapping = False
    scene.sequencer_colorspace_settings.name = "sRGB"
    scene.render.dither_intensity = 0.0


def decode_srgb(color: ArrayLike) -> NDArray[np.float64]:
    """Scene-linear light of display-referred sRGB values (IEC 61966-2-1)."""
    encoded = np.asarray(color, np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def set_cycles(scene: bpy.types.Scene) -> None:
    """One noise-free sample a pixel, through as many splats as a ray meets."""
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = 1
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.max_bounces = 0
    cycles.transparent_max_bounces = TRANSPARENT_BOUNCES
    cycles.min_transparent_bounces = TRANSPARENT_BOUNCES
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    cycles.filter_width = FILTER_WIDTH


def set_background(scene: bpy.types.Scene, color: ArrayLike) -> None:
    """An even background of the given colour, as the rasteriser puts behind the Gaussians.

    Args:
        color: RGB as the display setting has it: encoded values for `Display.PHOTO`, else scene-linear.
    """
    world = bpy.data.worlds.new(WORLD_NAME)
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (*np.asarray(color).tolist(), 1.0)
    background.inputs["Strength"].default_value = 1.0
    scene.world = world
    scene.render.film_transparent = False


def set_png(scene: bpy.types.Scene) -> None:
    """8-bit PNG output."""
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "IMAGE"
    settings.file_format = "PNG"
    settings.color_mode = "RGB"
    settings.color_depth = "8"
