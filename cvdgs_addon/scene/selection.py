"""Which points of a Gaussians' mesh are left by the crop box and the budget: in numpy what `selection_nodes` draw."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from .splat_nodes import Input
from .splats import get_input


def inside_crop_box(splats: bpy.types.Object, positions: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(V,) which of the (V, 3) positions the crop box leaves: those in the cube of side two around it."""
    box = get_input(splats, Input.CROP_BOX)
    if not get_input(splats, Input.CROP) or not isinstance(box, bpy.types.Object):
        return np.ones(len(positions), np.bool_)
    to_box = np.array(box.matrix_world.inverted_safe() @ splats.matrix_world, np.float64)
    return (np.abs(positions @ to_box[:3, :3].T + to_box[:3, 3]) <= 1.0).all(axis=1)


def within_budget(splats: bpy.types.Object, ranks: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(V,) which of the (V,) places by importance (see `Attribute.RANK`) are among those that the viewport draws."""
    budget = get_input(splats, Input.BUDGET)
    return ranks < budget if isinstance(budget, int) and budget > 0 else np.ones(len(ranks), np.bool_)
