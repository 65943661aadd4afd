"""Blender's side of cvdgs: registration of what Blender shows. Imports bpy and numpy, never torch or Warp."""

from __future__ import annotations

from types import ModuleType


def _modules() -> tuple[ModuleType, ...]:
    """Modules with register() and unregister(), in the order in which they need each other.

    Imported only when Blender asks: the process that converts runs shares this package and starts before it needs bpy.
    """
    from .. import operators, ui
    from . import activity, pictures, preferences, properties

    return preferences, pictures, properties, activity, operators, ui


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


def unregister() -> None:
    """Undo `register`, in the opposite order."""
    for module in reversed(_modules()):
        module.unregister()
