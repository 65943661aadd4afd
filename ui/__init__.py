"""The N-panel, tab "CVD": one file a sub-panel, in the order of the work."""

from __future__ import annotations

from ..cvdgs_addon.registration import register_classes, unregister_classes
from . import (
    capture,
    display,
    export,
    import_capture,
    report,
    run,
    simulate,
    turntable,
    viewer,
)

_MODULES = (capture, import_capture, viewer, run, display, simulate, turntable, report, export)
CLASSES: tuple[type, ...] = tuple(cls for module in _MODULES for cls in module.CLASSES)


def register() -> None:
    """Register all panels; those that come first stand on top."""
    register_classes(CLASSES)


def unregister() -> None:
    """Undo `register`."""
    unregister_classes(CLASSES)
