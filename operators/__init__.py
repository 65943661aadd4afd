"""Operators: one thin file a section of the panel. What they do is a function of `cvdgs_addon`."""

from __future__ import annotations

from . import alignment, capture, display, environment, export, relight, run, selection, turntable, viewer

_MODULES = (capture, viewer, run, display, selection, alignment, relight, turntable, export, environment)
CLASSES: tuple[type, ...] = tuple(cls for module in _MODULES for cls in module.CLASSES)
