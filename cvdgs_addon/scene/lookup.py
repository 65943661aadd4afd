"""Finds again what a background job was started for."""

from __future__ import annotations

import bpy


def scene_by_uid(session_uid: int) -> bpy.types.Scene | None:
    """The scene with this `bpy.types.ID.session_uid`, whatever it is called by now; None where it is gone."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == session_uid), None)
