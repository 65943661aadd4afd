"""What the N-panel keeps with the scene, as ``scene.cvdgs``: one group of properties a sub-panel."""

from __future__ import annotations

import bpy

from ..registration import register_classes, unregister_classes
from . import capture, display, run, simulate, turntable, viewer


class SceneProperties(bpy.types.PropertyGroup):
    """``scene.cvdgs``, saved with the .blend and part of its undo history."""

    capture: bpy.props.PointerProperty(type=capture.CaptureProperties)
    viewer: bpy.props.PointerProperty(type=viewer.ViewerProperties)
    run: bpy.props.PointerProperty(type=run.RunProperties)
    display: bpy.props.PointerProperty(type=display.DisplayProperties)
    simulate: bpy.props.PointerProperty(type=simulate.SimulateProperties)
    turntable: bpy.props.PointerProperty(type=turntable.TurntableProperties)


CLASSES: tuple[type, ...] = (
    *capture.CLASSES,
    *viewer.CLASSES,
    *run.CLASSES,
    *display.CLASSES,
    *simulate.CLASSES,
    *turntable.CLASSES,
    SceneProperties,
)


def register() -> None:
    """Give every scene its ``cvdgs``."""
    register_classes(CLASSES)
    bpy.types.Scene.cvdgs = bpy.props.PointerProperty(type=SceneProperties)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Scene.cvdgs
    unregister_classes(CLASSES)
