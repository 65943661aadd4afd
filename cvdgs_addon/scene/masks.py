"""Selecting Gaussians, and masks of them that the node group honours: removed, or kept in their original colours.

A mask is an attribute of the points, so nothing is lost: layers can be added and all of it taken back. The selection is
Blender's own, that of Edit Mode, where box, circle and lasso choose points too.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum

import bmesh
import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError
from ...core.runs.layout import ORIGINAL
from ...core.splats.floaters import kept_after
from .crop import in_box
from .recolor import edited_layers, remove_edited_layers, restore
from .splat_attributes import (
    Attribute,
    Frame,
    color_attribute,
    hide_frame,
    is_gaussian,
    read_attribute,
    vertex_positions,
    write_attribute,
)
from .splats import is_splats

Mask = NDArray[np.bool_]
_MOST_ADDED = 100_000  # points among which the frame is looked for at every change in Edit Mode, from the last one


class Treatment(Enum):
    """What is done with the selected Gaussians."""

    REMOVE = "REMOVE"
    KEEP_ORIGINAL = "KEEP_ORIGINAL"
    RESTORE = "RESTORE"


def by_color(splats: bpy.types.Object, color: ArrayLike, tolerance: float) -> Mask:
    """(V,) Gaussians whose original sRGB colour differs from `color` by at most `tolerance` in every channel."""
    colors = read_attribute(splats.data, color_attribute(ORIGINAL))[:, :3]
    return np.abs(colors - np.asarray(color, np.float32)).max(axis=1) <= tolerance


def by_floater_score(splats: bpy.types.Object, least: float) -> Mask:
    """(V,) Gaussians whose score as a floater is at least `least`.

    Raises:
        InputError: the run has no scores.
    """
    return _floater_scores(splats) >= least


def by_box(splats: bpy.types.Object) -> Mask:
    """(V,) Gaussians inside the crop box.

    Raises:
        InputError: there is none.
    """
    return in_box(splats, vertex_positions(splats.data))


def select(splats: bpy.types.Object, chosen: Mask, *, extend: bool) -> int:
    """Select the Gaussians among the (V,) `chosen` points; returns how many are selected then.

    Args:
        splats: in Object Mode (see `object_mode`).
        chosen: the points.
        extend: keep what is selected already.
    """
    mesh = splats.data
    wanted = chosen & is_gaussian(mesh)
    if extend:
        wanted |= selected(splats)
    if Attribute.REMOVED in mesh.attributes:
        wanted &= ~read_attribute(mesh, Attribute.REMOVED)
    mesh.vertices.foreach_set("select", wanted)
    mesh.update()
    return int(wanted.sum())


def selected(splats: bpy.types.Object) -> Mask:
    """(V,) which Gaussians are selected."""
    flags = np.empty(len(splats.data.vertices), np.bool_)
    splats.data.vertices.foreach_get("select", flags)
    return flags & is_gaussian(splats.data)


def treat_selected(splats: bpy.types.Object, treatment: Treatment) -> int:
    """Treat the selected Gaussians of an object in Object Mode; returns how many they are.

    Raises:
        InputError: none is selected.
    """
    chosen = selected(splats)
    if not chosen.any():
        raise InputError("no Gaussians are selected", where=splats.name, remedy="select some first")
    if treatment is Treatment.KEEP_ORIGINAL:
        _write(splats, Attribute.KEPT_ORIGINAL, "FLOAT", _existing(splats, Attribute.KEPT_ORIGINAL) | chosen)
    elif treatment is Treatment.RESTORE:
        _write(splats, Attribute.KEPT_ORIGINAL, "FLOAT", _existing(splats, Attribute.KEPT_ORIGINAL) & ~chosen)
        restore(splats, chosen)
    else:
        _remove(splats, _existing(splats, Attribute.REMOVED) | chosen)
    return int(chosen.sum())


def remove_floaters(splats: bpy.types.Object, amount: float) -> int:
    """Remove what ``run.py --clean`` removes for `amount`, 0 to 1; returns how many Gaussians those are.

    Raises:
        InputError: the run has no scores, or none would be left.
    """
    chosen = is_gaussian(splats.data) & ~kept_after(_floater_scores(splats), amount)
    removed = _existing(splats, Attribute.REMOVED) | chosen
    if not (is_gaussian(splats.data) & ~removed).any():
        raise InputError("all its Gaussians would be removed", where=splats.name, remedy="choose a smaller amount")
    if chosen.any():
        _remove(splats, removed)
    return int(chosen.sum())


def take_all_back(splats: bpy.types.Object) -> None:
    """Show all Gaussians again, in the layer's colours; those that were deleted in Edit Mode stay away."""
    _remove(splats, np.zeros(len(splats.data.vertices), np.bool_))
    for name in (Attribute.REMOVED, Attribute.KEPT_ORIGINAL):
        attribute = splats.data.attributes.get(name)
        if attribute is not None:
            splats.data.attributes.remove(attribute)
    remove_edited_layers(splats)
    splats.data.update()


def has_masks(splats: bpy.types.Object) -> bool:
    """Whether something was removed, recoloured or kept in its original colours."""
    masks = (Attribute.REMOVED, Attribute.KEPT_ORIGINAL)
    return any(name in splats.data.attributes for name in masks) or bool(edited_layers(splats))


@contextmanager
def object_mode(splats: bpy.types.Object, *, end_in_edit_mode: bool = False) -> Iterator[None]:
    """Within the block the attributes of `splats` can be reached; Edit Mode is back after it, or begins."""
    was_edited = splats.mode == "EDIT"
    if splats.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    is_done = False
    try:
        yield
        is_done = True
    finally:
        if was_edited or (is_done and end_in_edit_mode):
            edit_points(splats)


def edit_points(splats: bpy.types.Object) -> None:
    """Let Blender select points of `splats`: Edit Mode, with vertices to choose.

    Raises:
        InputError: they are hidden.
    """
    context = bpy.context
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    if splats.name not in context.view_layer.objects or not splats.visible_get():
        raise InputError("it is hidden", where=splats.name, remedy="show it, or tick its collection in the Outliner")
    for other in context.selected_objects:
        other.select_set(False)
    splats.select_set(True)
    context.view_layer.objects.active = splats
    hide_frame(splats.data)  # files of earlier releases have it in sight
    bpy.ops.object.mode_set(mode="EDIT")
    context.tool_settings.mesh_select_mode = (True, False, False)


@bpy.app.handlers.persistent
def hide_again(*_: object) -> None:
    """Hide in Edit Mode what Blender's *Reveal* (Alt+H) has brought into sight beside what the artist had hidden."""
    # Renders that a window starts come here on a thread of theirs.
    if threading.current_thread() is not threading.main_thread() or bpy.context.mode != "EDIT_MESH":
        return
    for edited in bpy.context.view_layer.objects:
        if edited.mode == "EDIT" and is_splats(edited):
            _hide_again(edited.data)


def _hide_again(mesh: bpy.types.Mesh) -> None:
    """Hide the frame and what was removed, if the frame is in sight."""
    points = bmesh.from_edit_mesh(mesh)
    numbers, removed = points.verts.layers.int.get(Attribute.FRAME), points.verts.layers.bool.get(Attribute.REMOVED)
    if numbers is None or all(point.hide for point in _frame_of(points, numbers)):
        return
    for point in points.verts:
        if point[numbers] or (removed is not None and point[removed]):
            point.select_set(False)
            point.hide_set(True)
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


def _frame_of(points: bmesh.types.BMesh, numbers: bmesh.types.BMLayerItem) -> list[bmesh.types.BMVert]:
    """The points of the frame: the last ones, but for those that somebody has duplicated or extruded since."""
    points.verts.ensure_lookup_table()
    count, found = len(points.verts), []
    for index in range(count - 1, max(count - _MOST_ADDED, 0) - 1, -1):  # a slice walks over all points
        point = points.verts[index]
        if point[numbers]:
            found.append(point)
            if len(found) == len(Frame):
                break
    return found


def _floater_scores(splats: bpy.types.Object) -> NDArray[np.float32]:
    if Attribute.FLOATER not in splats.data.attributes:
        raise InputError("its run has no floater scores", where=splats.name, remedy="select by hand, colour or box")
    return read_attribute(splats.data, Attribute.FLOATER)


def _existing(splats: bpy.types.Object, name: str) -> Mask:
    if name not in splats.data.attributes:
        return np.zeros(len(splats.data.vertices), np.bool_)
    return read_attribute(splats.data, name) > 0.5


def _remove(splats: bpy.types.Object, removed: Mask) -> None:
    """Nor can anybody select them in Edit Mode."""
    _write(splats, Attribute.REMOVED, "BOOLEAN", removed)
    splats.data.vertices.foreach_set("select", selected(splats) & ~removed)
    splats.data.vertices.foreach_set("hide", removed | ~is_gaussian(splats.data))


def _write(splats: bpy.types.Object, name: str, kind: str, values: Mask) -> None:
    write_attribute(splats.data, name, kind, values if kind == "BOOLEAN" else values.astype(np.float32))
    splats.data.update()
