"""A capture's size from one distance that is known: between two marks, which an artist moves to its ends."""

from __future__ import annotations

from pathlib import Path

import bpy
import mathutils
import numpy as np

from ...core.errors import InputError
from ...core.runs.measured import note_metres
from .beside import link_beside
from .import_capture import middle_of, scale_ranges
from .origin import run_of
from .placement import metres_of_unit, metres_shown, set_metres
from .world_matrix import world_of

_END = "cvdgs_ruler"  # custom property of an Empty: which end of the ruler it is
_APART, _SIZE = 0.2, 0.02  # of new ends around the middle and of their spheres, in distances of the cameras
_LONGEST = 1e6  # metres


def add_ruler(empty: bpy.types.Object) -> list[bpy.types.Object]:
    """The two ends of the ruler of the capture of `empty`, made where they are missing, around its middle."""
    center, distance = middle_of(empty)
    ends = ends_of(empty)
    for number, name in enumerate("AB"):
        if name not in ends:
            end = bpy.data.objects.new(f"{name} of {empty.name}", None)
            end[_END] = name
            end.empty_display_type, end.empty_display_size = "SPHERE", _SIZE * distance
            end.show_name = end.show_in_front = True
            end.parent = empty
            end.location = center + np.array([(number - 0.5) * _APART * distance, 0.0, 0.0])
            link_beside(empty, end)
            ends[name] = end
    return [ends[name] for name in "AB"]


def ends_of(empty: bpy.types.Object) -> dict[str, bpy.types.Object]:
    """The ends of a capture's ruler by name, those that are in the scene."""
    return {found[_END]: found for found in empty.children if _END in found and found.users_scene}


def measure(empty: bpy.types.Object, metres: float) -> list[Path]:
    """Resize a capture around the middle of its ruler so that the ends of it are so many metres apart.

    The runs of its Gaussians keep that in their files, so that what is exported has it, too.

    Returns:
        The folders of these runs.

    Raises:
        InputError: there is no ruler, its ends are in one place, the length is none, or a run's file cannot be written.
    """
    bpy.context.view_layer.update()
    ends = ends_of(empty)
    if len(ends) < 2:
        raise InputError("no ruler", where=empty.name, remedy="add one, and move its ends to two places")
    first, second = (np.array(world_of(ends[name]).translation, np.float64) for name in "AB")
    scene = bpy.context.scene
    apart = float(np.linalg.norm(second - first)) * metres_of_unit(scene)
    if not apart > 0.0 or not 0.0 < metres <= _LONGEST:
        raise InputError("the ruler has no length", where=empty.name, remedy="move its ends to two places")
    ratio = metres / apart
    unit = ratio * metres_shown(empty, scene)
    folders = [Path(folder) for folder in sorted({run_of(child) for child in empty.children}) if folder]
    # First what may fail, so that a run that cannot be told leaves the scene as it is.
    told = [folder for folder in folders if _is_told(folder, unit)]
    middle = mathutils.Matrix.Translation(((first + second) / 2.0).tolist())
    empty.matrix_world = middle @ mathutils.Matrix.Scale(ratio, 4) @ middle.inverted() @ world_of(empty)
    scale_ranges(empty, ratio)
    set_metres(empty, unit)
    bpy.context.view_layer.update()
    return told


def _is_told(folder: Path, metres_per_unit: float) -> bool:
    try:
        return note_metres(folder, metres_per_unit)
    except OSError as error:
        remedy = "allow writing there, or load a copy of the run"
        raise InputError(f"cannot be written ({error.strerror or error})", where=folder, remedy=remedy) from None
