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
    return _in_full(splats, _file_of(override.reference.library if override is not None else splats.library))


def keep_runs(path: str) -> None:
    """Name the runs of the file's Gaussians so that they are found from where it is about to be saved, at `path`."""
    if path:  # not the start file
        _name_runs(bpy.data.filepath, path)


def keep_open_runs(path: str) -> None:
    """Name the runs so that they are found from where the open file is, after `keep_runs` named them for `path`.

    That is elsewhere where a copy was saved, or the file could not be.
    """
    if path:
        _name_runs(path, bpy.data.filepath)


def keep_appended_run(splats: bpy.types.Object, library: bpy.types.Library) -> None:
    """Let Gaussians that were appended from `library` name the run beside that file, not beside the open one."""
    run = _in_full(splats, _file_of(library))
    if run and splats.library is None:
        splats[RUN_PROPERTY] = run


def _name_runs(source: str, target: str) -> None:
    """Let the file's own Gaussians, whose runs are named as in the .blend `source`, name them as in `target`."""
    folder = os.path.normpath(os.path.dirname(target)) if target else None
    for splats in bpy.data.objects:
        run = _in_full(splats, source) if splats.library is None and splats.override_library is None else ""
        named = BESIDE if run == folder else run
        if run and named != splats[RUN_PROPERTY]:
            splats[RUN_PROPERTY] = named


def _file_of(library: bpy.types.Library | None) -> str:
    return bpy.path.abspath(library.filepath) if library is not None else bpy.data.filepath


def _in_full(splats: bpy.types.Object, file: str) -> str:
    """The folder of the run, named as in the .blend `file`; "" where none is known."""
    folder = splats.get(RUN_PROPERTY)
    if not isinstance(folder, str) or not folder:
        return ""
    if folder.startswith(BESIDE) and not file:
        return ""  # nothing is beside a file that was never saved
    return os.path.normpath(bpy.path.abspath(folder, start=os.path.dirname(file)))
