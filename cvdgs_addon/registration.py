"""Classes known to Blender: all of a list, or none."""

from __future__ import annotations

from collections.abc import Sequence

import bpy


def register_classes(classes: Sequence[type]) -> None:
    """Register `classes` in order; when one is refused, the others are taken back."""
    done: list[type] = []
    try:
        for cls in classes:
            bpy.utils.register_class(cls)
            done.append(cls)
    except Exception:
        unregister_classes(done)
        raise


def unregister_classes(classes: Sequence[type]) -> None:
    """Undo `register_classes`."""
    for cls in reversed(classes):
        bpy.utils.unregister_class(cls)
