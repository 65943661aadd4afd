"""Where a capture stands in a Blender scene: upright, of sensible size, undone by clearing one Empty's transform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...core.capture.folder import CaptureView, mean_up
from .world_matrix import scale_of, world_of

# Custom properties of the Empty.
_IS_CAPTURE, _UP, _METRES = "cvdgs_capture", "cvdgs_up", "cvdgs_metres_per_unit"

# A capture whose +Z is within this angle of up is taken to be upright already, and stays as it is.
_UPRIGHT_TOLERANCE = np.radians(25.0)
# The same where the worker has found out what is up.
_KNOWN_TOLERANCE = np.radians(1.0)
# Distances from camera to subject that suit Blender's units, grid and clipping, and what another one is scaled to.
_COMFORTABLE_DISTANCE = (0.3, 30.0)  # metres
_DISTANCE = 3.0  # metres


class Up(Enum):
    """Which direction of a capture's world is up."""

    AUTO = "AUTO"
    """What the worker found, else the mean of the cameras' up directions, unless +Z is near it already."""

    X, Y, Z = "X", "Y", "Z"
    NEGATIVE_X, NEGATIVE_Y, NEGATIVE_Z = "-X", "-Y", "-Z"


@dataclass(frozen=True)
class Placing:
    """How a capture is set into the scene.

    Attributes:
        up: which of its directions becomes +Z.
        distance: of the cameras from the subject in scene units, by which it is scaled; 0: left as it is where that
            suits Blender's grid and clipping, else a few metres.
    """

    up: Up = Up.AUTO
    distance: float = 0.0


@dataclass(frozen=True)
class Found:
    """What the worker knows of a capture's world.

    Attributes:
        up: (3,) unit vector, or None.
        metres_per_unit: or None where nobody has measured it.
    """

    up: NDArray[np.float64] | None = None
    metres_per_unit: float | None = None


NOTHING_FOUND = Found()


def placement(
    views: Sequence[CaptureView],
    center: NDArray[np.float64],
    placing: Placing = Placing(),
    found: Found = NOTHING_FOUND,
    metres: float = 1.0,
) -> NDArray[np.float64]:
    """(4, 4) similarity from the capture's world to Blender's, the identity where that suits already.

    Structure from motion has neither up nor size. The mean of the cameras' up directions is up; the subject's distance
    becomes a few metres, and its centre the origin.

    Args:
        views: the cameras.
        center: (3,) of the subject.
        placing: what to do instead.
        found: what is known of the capture's world.
        metres: that a unit of the scene has (see `metres_of_unit`), for a capture whose size is known.
    """
    if placing.up is Up.AUTO and found.up is not None:
        rotation = _rotation(found.up, _KNOWN_TOLERANCE)
    else:
        tolerance = _UPRIGHT_TOLERANCE if placing.up is Up.AUTO else 0.0
        rotation = _rotation(_up_direction(views, placing.up), tolerance)
    if found.metres_per_unit and not placing.distance:
        scale = found.metres_per_unit / metres
    else:
        scale = _scale(camera_distance(views, center), placing.distance)
    if scale == 1.0 and np.array_equal(rotation, np.eye(3)):
        return np.eye(4)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation
    matrix[:3, 3] = -scale * rotation @ center
    return matrix


def _up_direction(views: Sequence[CaptureView], up: Up) -> NDArray[np.float64]:
    if up is not Up.AUTO:
        sign = -1.0 if up.value.startswith("-") else 1.0
        return sign * np.eye(3)["XYZ".index(up.value[-1])]
    return mean_up(views)


def _rotation(up: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """(3, 3) that takes `up` to +Z; the identity where that is within the angle `tolerance`."""
    if np.arccos(np.clip(up[2], -1.0, 1.0)) <= tolerance:
        return np.eye(3)
    return np.array(mathutils.Vector(up).rotation_difference((0.0, 0.0, 1.0)).to_matrix(), np.float64)


def _scale(distance: float, wanted: float) -> float:
    low, high = _COMFORTABLE_DISTANCE
    if wanted > 0.0:
        return wanted / distance
    return 1.0 if low <= distance <= high else _DISTANCE / distance


def camera_distance(views: Sequence[CaptureView], center: NDArray[np.float64]) -> float:
    """Median distance of the cameras from `center`, never zero."""
    positions = np.stack([view.camera_to_world[:3, 3] for view in views])
    return max(float(np.median(np.linalg.norm(positions - center, axis=1))), 1e-6)


def add_empty(
    name: str,
    matrix: NDArray[np.float64],
    size: float,
    collection: bpy.types.Collection,
    found: Found = NOTHING_FOUND,
) -> bpy.types.Object:
    """The Empty that carries cameras and Gaussians, its axes `size` scene units long; it remembers what is `found`."""
    empty = bpy.data.objects.new(name, None)
    empty.empty_display_type = "ARROWS"
    empty.empty_display_size = size
    empty.rotation_mode = "QUATERNION"
    empty.matrix_basis = mathutils.Matrix(matrix.tolist())
    empty[_IS_CAPTURE] = True
    if found.up is not None:
        empty[_UP] = found.up.tolist()
    if found.metres_per_unit:
        empty[_METRES] = found.metres_per_unit
    collection.objects.link(empty)
    return empty


def found_of(empty: bpy.types.Object) -> Found:
    """What `add_empty` was told of `empty`; nothing where someone has changed it beyond use."""
    up = np.array(empty.get(_UP, ()), np.float64).ravel()
    length = float(np.linalg.norm(up))
    is_direction = up.shape == (3,) and 0.0 < length < np.inf
    metres = float(empty.get(_METRES, 0.0))
    return Found(up / length if is_direction else None, metres if 0.0 < metres < np.inf else None)


def set_metres(empty: bpy.types.Object, metres_per_unit: float) -> None:
    """Let `empty` remember how many metres a unit of its capture has."""
    empty[_METRES] = metres_per_unit


def metres_of_unit(scene: bpy.types.Scene) -> float:
    """Metres that a unit of `scene` has: its Unit Scale, which Blender heeds where it shows lengths with units."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)


def metres_shown(empty: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Metres that a unit of a capture has as it stands in `scene`, measured or not."""
    return scale_of(world_of(empty)) * metres_of_unit(scene)


def is_capture(candidate: bpy.types.Object) -> bool:
    """Whether `candidate` is an Empty that `add_empty` made."""
    return candidate.type == "EMPTY" and _IS_CAPTURE in candidate
