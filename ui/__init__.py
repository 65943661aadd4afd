"""The N-panel, tab "CVD": one file a sub-panel, in the order of the work."""

from __future__ import annotations

import bpy

from . import capture, display, export, report, run, simulate, viewer

_MODULES = (capture, viewer, run, display, simulate, report, export)
CLASSES: tuple[type, ...] = tuple(cls for module in _MODULES for cls in module.CLASSES)


def register() -> None:
    """Register all panels; those that come first stand on top."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
