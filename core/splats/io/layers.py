"""The layers of a scene: Gaussians that share their geometry and have colours of their own. numpy only.

Some formats hold the geometry once and the colours of every layer; what they have in common is here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from math import inf, sqrt
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.untrusted import is_file, read_json
from ...runs.layout import GAUSSIANS_FILE, ORIGINAL, REPORT_FILE, layer_gaussians_file, layer_of
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


def turn_to_y(up: str) -> tuple[float, float, float, float] | None:
    """The rotation, as a quaternion xyzw, that turns `up` to +Y: an axis of `TO_Y_UP`, or three numbers ``x,y,z``.

    None where `up` is empty.

    Raises:
        ValueError: `up` is no direction.
    """
    if not up or up in TO_Y_UP:
        return TO_Y_UP.get(up)
    x, y, z = direction_of(up)
    if y <= _OPPOSITE:
        return TO_Y_UP["-y"]
    # The shortest turn: about the axis at right angles to both.
    w = sqrt(0.5 * (1.0 + y))
    return -z / (2.0 * w), 0.0, x / (2.0 * w), w


def direction_of(up: str) -> tuple[float, float, float]:
    """The unit vector of an axis of the scene, such as ``-y``, or of three numbers ``x,y,z``.

    Raises:
        ValueError: `up` is no direction.
    """
    x, y, z = _AXES[up] if up in _AXES else (float(number) for number in up.split(","))
    length = sqrt(x * x + y * y + z * z)
    if not 0.0 < length < inf:
        raise ValueError("no direction")
    return x / length, y / length, z / length


def world_of_run(file: Path) -> tuple[str, float]:
    """What the report beside a run's `file` of Gaussians says of its world; the defaults where it says nothing.

    Returns:
        What is up, as `turn_to_y` takes it or empty, and the metres in a unit, 1 where that is not known.
    """
    report = file.parent / REPORT_FILE
    if not is_file(report):
        return "", 1.0
    try:
        capture = read_json(report, remedy="give --up")["capture"]
        up = ",".join(f"{float(value):.6g}" for value in capture["up"])
        turn_to_y(up)
        metres = float(capture["metres_per_unit"] or 1.0)
    except (InputError, KeyError, TypeError, ValueError, OverflowError):
        return "", 1.0  # of another program, or of a version that did not look for it
    axes = {",".join(f"{value:g}" for value in axis): name for name, axis in _AXES.items()}
    return axes.get(up, up), metres if 0.0 < metres < inf else 1.0


_AXES: Mapping[str, tuple[float, ...]] = {
    f"{sign}{name}": tuple((-1.0 if sign else 1.0) if name == other else 0.0 for other in "xyz")
    for name in "xyz"
    for sign in ("", "-")
}
_OPPOSITE = -1.0 + 1e-12  # cosine of half a turn
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
    """`other`, with all of its arrays but the colours replaced by those of `first`.

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
