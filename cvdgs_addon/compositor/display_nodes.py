"""Nodes that turn scene-linear light into what the screen shows, for view transforms that are more than sRGB.

A simulation of what people see has to come after the view transform. Raw and Standard need no nodes: with Raw the
picture already holds screen values, and Standard only encodes, which commutes with simulating in linear light. For the
others (AgX, Filmic, ...) the transform moves into the compositor, and the scene's own becomes Raw meanwhile.
"""

from __future__ import annotations

from enum import Enum

import bpy

from ..scene.remembered_settings import Setting
from ..scene.render_settings import RAW, STANDARD

_HAS_NODE = hasattr(bpy.types, "CompositorNodeConvertToDisplay")
# Before that node: the colour spaces of Blender's OpenColorIO configuration that view transforms end in.
_VIEW_SPACES = {
    "AgX": "AgX Base sRGB",
    "Filmic": "Filmic sRGB",
    "Khronos PBR Neutral": "Khronos PBR Neutral sRGB",
    STANDARD: "sRGB",
}


class Picture(Enum):
    """What the simulation has to take a scene's picture for."""

    SCENE_LINEAR = "light, which the view transform only encodes"
    DISPLAY = "screen values"
    CONVERTED = "light, which has to be converted to screen values first"


def picture_kind(scene: bpy.types.Scene) -> Picture:
    """What the scene's picture is before the view transform."""
    view = scene.view_settings
    if view.view_transform == RAW:
        return Picture.DISPLAY
    if view.view_transform == STANDARD and _is_neutral(view):
        return Picture.SCENE_LINEAR
    if _HAS_NODE or view.view_transform in _VIEW_SPACES:
        return Picture.CONVERTED
    return Picture.SCENE_LINEAR


def what_is_left_out(scene: bpy.types.Scene) -> str:
    """The part of the scene's view settings that `add_display_nodes` cannot reproduce in this Blender, in words."""
    view = scene.view_settings
    parts = {
        f"view transform {view.view_transform}": not _HAS_NODE and view.view_transform not in (*_VIEW_SPACES, RAW),
        "look": not _HAS_NODE and view.look != "None",
        "gamma": view.gamma != 1.0,
        "curves": view.use_curve_mapping,
        "white balance": view.use_white_balance,
    }
    return ", ".join(name for name, is_there in parts.items() if is_there)


def add_display_nodes(tree: bpy.types.NodeTree, scene: bpy.types.Scene) -> list[bpy.types.Node]:
    """Add the scene's view transform as nodes, in the order in which the picture passes them; nothing is linked."""
    view = scene.view_settings
    exposure = tree.nodes.new("CompositorNodeExposure")
    exposure.inputs["Exposure"].default_value = view.exposure
    if not _HAS_NODE:
        convert = tree.nodes.new("CompositorNodeConvertColorSpace")
        convert.to_color_space = _VIEW_SPACES[view.view_transform]
        return [exposure, convert]
    convert = tree.nodes.new("CompositorNodeConvertToDisplay")
    convert.display_settings.display_device = scene.display_settings.display_device
    convert.view_settings.view_transform = view.view_transform
    convert.view_settings.look = view.look
    return [exposure, convert]


def raw_view() -> dict[str, Setting]:
    """Settings of a scene under which screen values are shown unchanged, by path."""
    return {
        "view_settings.look": "None",
        "view_settings.view_transform": RAW,
        "view_settings.exposure": 0.0,
        "view_settings.gamma": 1.0,
        "view_settings.use_curve_mapping": False,
        "view_settings.use_white_balance": False,
    }


def _is_neutral(view: bpy.types.ColorManagedViewSettings) -> bool:
    return (
        view.look == "None"
        and view.exposure == 0.0
        and view.gamma == 1.0
        and not view.use_curve_mapping
        and not view.use_white_balance
    )
