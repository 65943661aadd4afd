"""Blender's side of cvdgs: registration of what Blender shows. Imports bpy and numpy, never torch or Warp."""

from __future__ import annotations

import atexit
from types import ModuleType


def _modules() -> tuple[ModuleType, ...]:
    """Modules with register() and unregister(), in the order in which they need each other.

    Imported only when Blender asks: the process that converts runs shares this package and starts before it needs bpy.
    """
    from .. import operators, ui
    from . import activity, history, pictures, preferences_panel, properties

    return preferences_panel, pictures, properties, activity, history, operators, ui


def register() -> None:
    """Register with Blender; either everything or, when one module fails, nothing."""
    done: list[ModuleType] = []
    try:
        for module in _modules():
            module.register()
            done.append(module)
    except Exception:
        for module in reversed(done):
            module.unregister()
        raise
    # The bpy wheel of Blender 4.5 hangs at its exit when classes or timers are left; Blender itself comes first.
    atexit.register(unregister)


def unregister() -> None:
    """Undo `register`, in the opposite order."""
    atexit.unregister(unregister)
    for module in reversed(_modules()):
        module.unregister()
