"""Brings one run onto another of the same place: by pairs of marks that an artist sets, or by photographs of both."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import bpy
import mathutils
import numpy as np

from ...core.errors import InputError
from ...core.splats.similarity import FEWEST, fit_similarity
from .beside import link_beside
from .cameras import is_capture_camera, view_key
from .import_capture import scale_ranges
from .placement import found_of, is_capture, metres_of_unit, metres_shown, set_metres
from .splat_attributes import core_of
from .world_matrix import world_of

_MARK = "cvdgs_mark"  # custom property of an Empty: the number of its pair
_SPREAD, _SIZE = 0.4, 0.04  # of new marks around the middle and of their spheres, in radii of the core
_SAME_SIZE = 1e-3  # largest relative difference of two sizes that are taken for one
_MOST_ERROR = 0.05  # of cameras that should coincide, in shares of how far they are apart


@dataclass(frozen=True)
class Alignment:
    """How well two runs fit together.

    Attributes:
        pairs: points that were compared.
        error: root of their mean squared distance then, in metres where `is_metric`, else in units of the scene.
        scale: by which the moved run was resized.
        is_metric: whether they have their true size now.
    """

    pairs: int
    error: float
    scale: float
    is_metric: bool

    @property
    def in_words(self) -> str:
        """E.g. "3 pairs, 0.012 m apart on average, scale 1.50"."""
        unit = " m" if self.is_metric else ""
        return f"{self.pairs} pairs, {self.error:.3g}{unit} apart on average, scale {self.scale:.3g}"


def add_marks(splats: bpy.types.Object, other: bpy.types.Object) -> list[bpy.types.Object]:
    """Add what is missing to three pairs of marks, else one more pair: an Empty of each run, to be moved to the same
    place of both; returns the new ones.
    """
    numbers = set(_marks_of(splats)) & set(_marks_of(other))
    wanted = range(1, max(FEWEST, len(numbers) + 1) + 1)
    made = []
    for owner in (splats, other):
        present = _marks_of(owner)
        made += [_add_mark(owner, number) for number in wanted if number not in present]
    return made


def set_marks(splats: bpy.types.Object, places: Mapping[int, mathutils.Vector]) -> None:
    """Give `splats` marks at these places of the scene, by their numbers, in place of those that it has."""
    for mark in list(_marks_of(splats).values()):
        bpy.data.objects.remove(mark)
    for number, place in places.items():
        mark = _add_mark(splats, number)
        bpy.context.view_layer.update()
        mark.matrix_world = mathutils.Matrix.Translation(place)


def places_of_marks(splats: bpy.types.Object) -> dict[int, mathutils.Vector]:
    """Where the marks of `splats` are in the scene, by their numbers."""
    marks = _marks_of(splats)
    return {number: world_of(marks[number]).translation for number in sorted(marks)}


def align_by_marks(moved: bpy.types.Object, fixed: bpy.types.Object) -> Alignment:
    """Move `moved`, with its capture, so that its marks come onto those of `fixed` of the same number.

    Raises:
        InputError: too few pairs, or all on one line.
    """
    return _align(moved, fixed, _marks_of(moved), _marks_of(fixed), "its marks")


def align_by_photographs(moved: bpy.types.Object, fixed: bpy.types.Object) -> Alignment:
    """Do the same by cameras of photographs that have the same names in both runs.

    Raises:
        InputError: too few of them, all on one line, or taken from other places.
    """
    return _align(moved, fixed, _cameras_of(moved), _cameras_of(fixed), "its cameras", most=_MOST_ERROR)


def metric(splats: bpy.types.Object) -> bool:
    """Whether the run of `splats` has its true size in the scene: it was measured, and not resized otherwise since."""
    root = splats.parent
    known = found_of(root).metres_per_unit if root is not None and is_capture(root) else None
    if known is None:
        return False
    bpy.context.view_layer.update()
    return math.isclose(metres_shown(root, bpy.context.scene), known, rel_tol=_SAME_SIZE)


def _align(
    moved: bpy.types.Object,
    fixed: bpy.types.Object,
    sources: Mapping[Any, bpy.types.Object],
    targets: Mapping[Any, bpy.types.Object],
    what: str,
    most: float = np.inf,
) -> Alignment:
    bpy.context.view_layer.update()
    common = [key for key in sources if key in targets]
    source, target = _places(sources[key] for key in common), _places(targets[key] for key in common)
    is_metric = metric(fixed)
    found = fit_similarity(source, target, with_scale=not (is_metric and metric(moved)), where=f"{moved.name}, {what}")
    width = float(np.sqrt(np.mean(((target - target.mean(axis=0)) ** 2).sum(axis=1))))
    if found.error > most * width:
        raise InputError(
            f"{len(common)} photographs have the same names, but not the same places",
            where=moved.name,
            remedy="mark points",
        )
    root = moved.parent or moved
    root.matrix_world = mathutils.Matrix(found.matrix.tolist()) @ world_of(root)
    scale_ranges(root, found.scale)
    bpy.context.view_layer.update()
    if not is_metric:
        return Alignment(len(common), found.error, found.scale, False)
    if is_capture(root):
        set_metres(root, metres_shown(root, bpy.context.scene))
    return Alignment(len(common), found.error * metres_of_unit(bpy.context.scene), found.scale, True)


def _places(objects: Iterable[bpy.types.Object]) -> np.ndarray:
    return np.array([world_of(found).translation for found in objects], np.float64).reshape(-1, 3)


def _family(splats: bpy.types.Object) -> Iterable[bpy.types.Object]:
    return (splats.parent or splats).children


def _marks_of(splats: bpy.types.Object) -> dict[int, bpy.types.Object]:
    return {found[_MARK]: found for found in _family(splats) if _MARK in found and found.users_scene}


def _cameras_of(splats: bpy.types.Object) -> dict[str, bpy.types.Object]:
    return {view_key(found): found for found in _family(splats) if is_capture_camera(found)}


def _add_mark(splats: bpy.types.Object, number: int) -> bpy.types.Object:
    """Around the middle, each in another direction, where it is seen."""
    center, radius = core_of(splats)
    angle = 2.4 * number
    mark = bpy.data.objects.new(f"Mark {number} of {splats.name}", None)
    mark[_MARK] = number
    mark.empty_display_type, mark.empty_display_size = "SPHERE", _SIZE * float(radius)
    mark.show_name = mark.show_in_front = True
    mark.parent = splats.parent or splats
    offset = _SPREAD * radius * np.array([np.cos(angle), np.sin(angle), 0.0])
    local = world_of(splats.parent).inverted_safe() @ world_of(splats) if splats.parent else mathutils.Matrix()
    mark.location = local @ mathutils.Vector((center + offset).tolist())
    link_beside(splats, mark)
    return mark
