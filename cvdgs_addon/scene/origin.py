"""The run that Gaussians came from, wherever they, or the file that holds them, are taken."""

from __future__ import annotations

import os

import bpy

from .finished_run import RUN_PROPERTY

BESIDE = "//"
"""What `RUN_PROPERTY` says of a run whose folder holds the .blend, so that both can be moved."""


def run_of(splats: bpy.types.Object) -> str:
    """The folder of the run that Gaussians came from, in full; "" where none is known."""
    override = splats.override_library
    return _in_full(splats, override.reference.library if override is not None else splats.library)


def keep_runs(path: str) -> None:
    """Name the runs of the file's Gaussians so that they are found from where it is about to be saved, at `path`."""
    folder = os.path.dirname(path)
    for splats in bpy.data.objects:
        run = run_of(splats) if folder and splats.library is None and splats.override_library is None else ""
        named = BESIDE if run == os.path.normpath(folder) else run
        if run and named != splats[RUN_PROPERTY]:
            splats[RUN_PROPERTY] = named


def keep_appended_run(splats: bpy.types.Object, library: bpy.types.Library) -> None:
    """Let Gaussians that were appended from `library` name the run beside that file, not beside the open one."""
    run = _in_full(splats, library)
    if run and splats.library is None:
        splats[RUN_PROPERTY] = run


def _in_full(splats: bpy.types.Object, library: bpy.types.Library | None) -> str:
    folder = splats.get(RUN_PROPERTY)
    if not isinstance(folder, str) or not folder:
        return ""
    if folder.startswith(BESIDE) and library is None and not bpy.data.filepath:
        return ""  # nothing is beside a file that was never saved
    return os.path.normpath(bpy.path.abspath(folder, library=library))
