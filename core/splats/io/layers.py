"""The layers of a scene: Gaussians that share their geometry and have colours of their own. numpy only.

Some formats hold the geometry once and the colours of every layer; what they have in common is here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from math import sqrt
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...runs.layout import GAUSSIANS_FILE, ORIGINAL, layer_gaussians_file, layer_of
from ..gaussians import Gaussians

_HALF = sqrt(0.5)
TO_Y_UP: Mapping[str, tuple[float, float, float, float]] = {
    "x": (0.0, 0.0, _HALF, _HALF),
    "y": (0.0, 0.0, 0.0, 1.0),
    "z": (-_HALF, 0.0, 0.0, _HALF),
    "-x": (0.0, 0.0, -_HALF, _HALF),
    "-y": (1.0, 0.0, 0.0, 0.0),
    "-z": (_HALF, 0.0, 0.0, _HALF),
}
"""By the axis of a scene that points up: the rotation, as a quaternion xyzw, that turns it to +Y."""
_GEOMETRY = tuple(field.name for field in fields(Gaussians) if field.name != "sh")


def layer_name(path: Path) -> str:
    """The layer that a file with one is taken for, after the names that a run gives its files."""
    name = path.with_suffix(Path(GAUSSIANS_FILE).suffix).name
    if name == GAUSSIANS_FILE:
        return ORIGINAL
    layer = layer_of(name)
    return layer if name == layer_gaussians_file(layer) else path.stem


def first_of(layers: Mapping[str, Gaussians], where: Path) -> Gaussians:
    """The layer whose geometry is everyone's.

    Raises:
        InputError: it has no Gaussians, which the formats with layers do not allow.
    """
    first = next(iter(layers.values()))
    if not len(first):
        raise InputError("there are no Gaussians to write", where=where, remedy="keep at least one")
    return first


def sharing_geometry(first: Gaussians, other: Gaussians, where: Path) -> Gaussians:
    """`other`, with the arrays of `first` in place of its own but for the colours.

    Raises:
        InputError: its geometry is another one.
    """
    for name in _GEOMETRY:
        ours, theirs = getattr(first, name), getattr(other, name)
        # As bits, because files may hold values that are no numbers.
        if ours.shape != theirs.shape or not np.array_equal(ours.view(np.uint32), theirs.view(np.uint32)):
            raise InputError(
                "its Gaussians are others than those of the first file",
                where=where,
                remedy="give the splats.ply and splats.<layer>.ply of one run",
            )
    return replace(first, sh=other.sh)
