"""Operators: one thin file a panel section. What they do is a function of `cvdgs_addon`."""

from __future__ import annotations

from ..cvdgs_addon.registration import register_classes, unregister_classes
from . import (
    capture,
    display,
    environment,
    export,
    import_capture,
    report,
    run,
    simulate,
    turntable,
    viewer,
)

_MODULES = (capture, import_capture, viewer, run, display, simulate, turntable, report, export, environment)
CLASSES: tuple[type, ...] = tuple(cls for module in _MODULES for cls in module.CLASSES)


def register() -> None:
    """Register all operators."""
    register_classes(CLASSES)


def unregister() -> None:
    """Undo `register`."""
    unregister_classes(CLASSES)
