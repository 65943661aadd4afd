"""Render settings that Gaussians need: what is seen are the photos' colours, without noise."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import ArrayLike

from .remembered_settings import Setting, is_offered, set_settings, setting_before

# Each splat on a ray takes a bounce; where fewer are guaranteed, Russian roulette adds noise (18 dB instead of 49).
TRANSPARENT_BOUNCES = 512
# With fewer, what is behind them is missing, and the scene looks like fog. 32 were measured too few, 128 enough.
FEWEST_BOUNCES = 128
# Blender's smallest pixel filter: the rasteriser, too, looks at the pixel's centre only. One sample is then enough.
FILTER_WIDTH = 0.01  # pixels

FOG = f"{{bounces}} of {TRANSPARENT_BOUNCES} transparent bounces: renders will be grey"

WORLD_NAME = "CVD Background"

RAW, STANDARD = "Raw", "Standard"  # view transforms
REC709 = "Linear Rec.709"
"""The working space whose light the Gaussians' colours are converted to."""
SIMULATION_VIEW = "cvdgs_simulation_view"
"""Purpose (see `remembered_settings`) for which the view transform moves into the compositor."""
_EEVEE = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"

_SAVED_AS_SHOWN: dict[str, Setting] = {"render.image_settings.color_management": "FOLLOW_SCENE"}

# Denoisers would take the weave of the Gaussians for noise.
_LIT_OBJECTS: dict[str, Setting] = {
    "cycles.samples": 64,
    "cycles.use_adaptive_sampling": True,
    "cycles.adaptive_threshold": 0.05,
    "cycles.adaptive_min_samples": 4,
    "cycles.preview_samples": 16,
    "cycles.use_preview_adaptive_sampling": True,
    "cycles.preview_adaptive_threshold": 0.1,
    "cycles.preview_adaptive_min_samples": 1,
    "cycles.max_bounces": 2,
}


class Display(Enum):
    """How trained colours, which are display-referred sRGB, get onto the screen."""

    PHOTO = "photo"
    """Splats are blended as trained, in encoded values, and shown unchanged (view transform Raw)."""

    SCENE_LINEAR = "scene-linear"
    """Splats are converted to light, blended as light, and shown through Standard: mixes with lit objects."""


class Engine(Enum):
    """What renders Gaussians."""

    CYCLES = "CYCLES"
    EEVEE = "EEVEE"


def display_settings(display: Display) -> dict[str, Setting]:
    """The view that `display` needs, by path from the scene; the Gaussians' input "Scene Linear" has to agree."""
    return {
        **_named_here("display_settings.display_device", "sRGB"),
        "view_settings.look": "None",  # first: looks belong to view transforms
        "view_settings.view_transform": RAW if display is Display.PHOTO else STANDARD,
        "view_settings.exposure": 0.0,
        "view_settings.gamma": 1.0,
        "view_settings.use_curve_mapping": False,
        "view_settings.use_white_balance": False,
        **_SAVED_AS_SHOWN,
        **_named_here("sequencer_colorspace_settings.name", "sRGB"),
        "render.dither_intensity": 0.0,
    }


def _named_here(path: str, name: str) -> dict[str, Setting]:
    """The setting, unless a studio's colour configuration (the variable OCIO) has no such name: *Raw* needs neither."""
    return {path: name} if is_offered(bpy.data.scenes[0], path, name) else {}


def engine_settings(engine: Engine, display: Display = Display.PHOTO) -> dict[str, Setting]:
    """What `engine` needs, by path from the scene.

    For Gaussians that is one noise-free sample a pixel, at its centre. With `Display.SCENE_LINEAR` lit objects are to
    be seen among them: those need many. Cycles adds samples only where they differ, so pixels of Gaussians get few.
    """
    if engine is Engine.EEVEE:
        return {"render.engine": _EEVEE, "eevee.taa_render_samples": 1, "render.filter_size": FILTER_WIDTH}
    return {
        "render.engine": "CYCLES",
        "cycles.samples": 1,
        "cycles.use_adaptive_sampling": False,
        "cycles.use_denoising": False,
        # The 3D view's as well: more samples are the same picture again, minutes of it without a graphics card.
        "cycles.preview_samples": 1,
        "cycles.use_preview_adaptive_sampling": False,
        "cycles.use_preview_denoising": False,
        "cycles.max_bounces": 0,
        "cycles.transparent_max_bounces": TRANSPARENT_BOUNCES,
        "cycles.min_transparent_bounces": TRANSPARENT_BOUNCES,
        "cycles.pixel_filter_type": "BLACKMAN_HARRIS",
        "cycles.filter_width": FILTER_WIDTH,
        **(_LIT_OBJECTS if display is Display.SCENE_LINEAR else {}),
    }


def fog_of(scene: bpy.types.Scene) -> str:
    """Why renders of Gaussians would be grey with the settings of `scene`; "" where they are not."""
    if scene.render.engine != "CYCLES" or scene.cycles.transparent_max_bounces >= FEWEST_BOUNCES:
        return ""
    return FOG.format(bounces=scene.cycles.transparent_max_bounces)


def view_transform_of(scene: bpy.types.Scene) -> str:
    """The view transform of `scene`, be it in the compositor."""
    return str(setting_before(scene, SIMULATION_VIEW, "view_settings.view_transform"))


def display_of(scene: bpy.types.Scene) -> Display:
    """How Gaussians have to be displayed for the view transform of `scene`."""
    return Display.PHOTO if view_transform_of(scene) == RAW else Display.SCENE_LINEAR


def what_changes_colors(scene: bpy.types.Scene) -> str:
    """What in `scene` changes the photographs' colours, in words; "" where nothing does."""
    view, saved = view_transform_of(scene), scene.render.image_settings
    if view not in (RAW, STANDARD):
        return view
    if setting_before(scene, SIMULATION_VIEW, "view_settings.use_white_balance"):
        return "White balance"
    if saved.color_management == "OVERRIDE" and saved.view_settings.view_transform != view:
        return f"{saved.view_settings.view_transform} of the output"
    return ""


def other_working_space() -> str:
    """The working space of the file, which shifts Gaussians of `Display.SCENE_LINEAR`; "" where it is `REC709`."""
    chosen = getattr(bpy.data, "colorspace", None)  # from Blender 5.0 on
    return chosen.working_space if chosen is not None and chosen.working_space != REC709 else ""


def set_display(scene: bpy.types.Scene, display: Display) -> None:
    """Set the view transform of `scene`; the Gaussians' input "Scene Linear" has to agree."""
    set_settings(scene, display_settings(display))


def set_cycles(scene: bpy.types.Scene) -> None:
    """Cycles on the processor: one noise-free sample a pixel, through as many splats as a ray meets."""
    set_settings(scene, engine_settings(Engine.CYCLES))
    scene.cycles.device = "CPU"


def set_background(scene: bpy.types.Scene, color: ArrayLike) -> None:
    """An even background of the given colour, as the rasteriser puts behind the Gaussians.

    Args:
        color: RGB as the display setting has it: encoded values for `Display.PHOTO`, else scene-linear.
    """
    scene.world = background_world(color)
    scene.render.film_transparent = False


def background_world(color: ArrayLike) -> bpy.types.World:
    """A new world of one colour, in the values that the scene works with."""
    world = bpy.data.worlds.new(WORLD_NAME)
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (*np.asarray(color).tolist(), 1.0)
    background.inputs["Strength"].default_value = 1.0
    return world


def literal_path(path: Path) -> str:
    """`path` as ``render.filepath`` has to spell it: Blender fills in what stands in single braces."""
    return str(path).replace("{", "{{").replace("}", "}}")


def png_settings() -> dict[str, Setting]:
    """8-bit PNG output, by path from the scene."""
    media: dict[str, Setting] = {"render.image_settings.media_type": "IMAGE"} if bpy.app.version >= (5, 0) else {}
    return {
        **media,
        "render.image_settings.file_format": "PNG",
        "render.image_settings.color_mode": "RGB",
        "render.image_settings.color_depth": "8",
        **_SAVED_AS_SHOWN,
    }


def set_png(scene: bpy.types.Scene) -> None:
    """8-bit PNG output."""
    set_settings(scene, png_settings())
