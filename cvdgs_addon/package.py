"""The add-on as Blender knows it: its name, and where its own files go."""

from __future__ import annotations

from pathlib import Path

import bpy

PACKAGE = __package__.rpartition(".")[0]
"""``bl_ext.<repository>.cvdgs`` as an extension, ``cvdgs`` under the bpy wheel."""


def user_folder() -> Path:
    """Where the extension may write, made by whoever does: Blender removes it with the extension, not on an upgrade."""
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE))
    except ValueError:  # not installed as an extension
        return Path(bpy.utils.user_resource("DATAFILES", path=PACKAGE))
