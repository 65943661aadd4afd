"""Blender's side of cvdgs: registration of what Blender shows. Imports bpy and numpy, never torch or Warp."""

from __future__ import annotations

from types import ModuleType

# Modules with register() and unregister(), in the order in which they need each other.
_MODULES: tuple[ModuleType, ...] = ()


def register() -> None:
    """Register with Blender; either everything or, when one module fails, nothing."""
    done: list[ModuleType] = []
    try:
        for module in _MODULES:
            module.register()
            done.append(module)
    except Exception:
        for module in reversed(done):
            module.unregister()
        raise


def unregister() -> None:
    """Undo `register`, in the opposite order."""
    for module in reversed(_MODULES):
        module.unregister()
