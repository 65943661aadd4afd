"""Operators: one thin file a section of the panel. What they do is a function of `cvdgs_addon`."""

from __future__ import annotations

from . import capture, display, environment, export, run, turntable, viewer

CLASSES: tuple[type, ...] = tuple(
    cls for module in (capture, viewer, run, display, turntable, export, environment) for cls in module.CLASSES
)
