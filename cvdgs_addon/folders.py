"""Folders as Blender's fields have them, and those that the add-on proposes."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from ..core.runtime.process import ROOT


def normalised_folder(folder: str) -> str:
    """A folder as Blender's fields have it (relative to the .blend, with a slash at the end), in full."""
    return os.path.normpath(bpy.path.abspath(folder))


def folder_beside(capture_folder: str, addition: str) -> str:
    """A folder for what is made of a capture, named after it."""
    capture = Path(normalised_folder(capture_folder))
    # The demo lies inside the extension, where nothing of the user's may be lost with an upgrade.
    parent = Path.home() if ROOT in capture.resolve().parents else capture.parent
    return str(parent / f"{capture.name} {addition}")
