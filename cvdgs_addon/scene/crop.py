"""The crop box of Gaussians: an Empty shown as a cube of side two, in whose space a position is inside or not."""

from __future__ import annotations

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from .beside import link_beside
from .splat_attributes import core_of
from .splat_nodes import Input
from .splats import get_input, is_splats, set_input
from .world_matrix import world_of

_CROP_MARGIN = 1.2  # of a new crop box, in radii of the scene's core


def add_crop_box(splats: bpy.types.Object) -> bpy.types.Object:
    """Crop `splats` to a box around most of them: an Empty that can be moved, turned and scaled. Returns it."""
    center, radius = core_of(splats)
    box = bpy.data.objects.new(f"{splats.name} Crop", None)
    box.empty_display_type, box.empty_display_size = "CUBE", 1.0
    box.matrix_basis = mathutils.Matrix.LocRotScale(center.tolist(), None, [_CROP_MARGIN * radius] * 3)
    box.parent = splats
    link_beside(splats, box)
    set_input(splats, Input.CROP_BOX, box)
    set_input(splats, Input.CROP, True)
    return box


def usable_crop_box(splats: bpy.types.Object) -> bpy.types.Object:
    """The crop box of `splats`, made where there is none; one that was deleted, and still crops, is brought back."""
    box = crop_box_of(splats)
    if box is None:
        return add_crop_box(splats)
    if not box.users_scene:
        link_beside(splats, box)
    return box


def crop_box_of(splats: bpy.types.Object) -> bpy.types.Object | None:
    """The crop box of `splats`, if there is one."""
    box = get_input(splats, Input.CROP_BOX)
    return box if isinstance(box, bpy.types.Object) else None


def remove_crop_box(splats: bpy.types.Object) -> None:
    """Show all of `splats` again and delete the box, unless other Gaussians have it too, as duplicates do."""
    box = crop_box_of(splats)
    set_input(splats, Input.CROP, False)
    set_input(splats, Input.CROP_BOX, None)
    others = (found for found in bpy.data.objects if is_splats(found) and found.users_scene)
    if box is not None and all(crop_box_of(other) != box for other in others):
        bpy.data.objects.remove(box)


def in_box(splats: bpy.types.Object, positions: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(V,) which of the (V, 3) positions lie in the crop box, whether or not it crops.

    Raises:
        InputError: there is no box.
    """
    box = crop_box_of(splats)
    if box is None:
        raise InputError("there is no crop box", where=splats.name, remedy="add one first")
    to_box = np.array(world_of(box).inverted_safe() @ world_of(splats), np.float64)
    return (np.abs(positions @ to_box[:3, :3].T + to_box[:3, 3]) <= 1.0).all(axis=1)


def left_by_crop(splats: bpy.types.Object, positions: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(V,) which of the (V, 3) positions the crop box leaves: all where nothing is cropped."""
    if not get_input(splats, Input.CROP) or crop_box_of(splats) is None:
        return np.ones(len(positions), np.bool_)
    return in_box(splats, positions)
