"""Blender's side of cvdgs. Imports bpy and numpy, never torch or Warp.

Nothing is imported before Blender asks: the processes that work for it share this package and start before bpy.
"""

from __future__ import annotations

import atexit


def register() -> None:
    """Register with Blender; either everything or, when one part fails, nothing."""
    import bpy

    from .registration import PARTS, register_all

    register_all(PARTS)
    # The bpy wheel of Blender 4.5 hangs at its exit when classes or timers are left. A Blender program disables its
    # add-ons by itself, and where a script ended it by `sys.exit` only after this, with nothing left to unregister.
    if not bpy.app.binary_path:
        atexit.register(unregister)


def unregister() -> None:
    """Undo `register`, in the opposite order."""
    from .registration import PARTS, unregister_all

    atexit.unregister(unregister)
    unregister_all(PARTS)
