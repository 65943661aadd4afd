"""Operators: one thin file a panel section. What they do is a function of `cvdgs_addon`."""

from __future__ import annotations

import bpy

from . import capture, display, environment, export, report, run, simulate, viewer

_MODULES = (capture, viewer, run, display, simulate, report, export, environment)
CLASSES: tuple[type, ...] = tuple(cls for module in _MODULES for cls in module.CLASSES)


def register() -> None:
    """Register all operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
