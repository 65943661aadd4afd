"""How long a unit of a capture's world is, from printed tags of known size in its photographs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .model import View
from .tags import find_tags

WHERE = "--scale"
_LEAST_VIEWS = 2
_LEAST_ANGLE = np.radians(2.0)  # between two rays to a tag, below which its distance is not known
_OFF = 3.0  # pixels between a corner and where it was seen, beyond which a photograph does not agree; a moved tag, say
_LEAST_AGREEING = 0.6  # of the photographs that show a tag
_UNEVEN = 0.05  # by how much the sides of one tag, or the sizes of two, may differ


@dataclass(frozen=True)
class Sighting:
    """A tag as one photograph shows it.

    Attributes:
        corners: (4, 2) in pixels.
        projection: (3, 4), from the world to pixels.
        center: (3,) where the camera was.
    """

    corners: NDArray[np.float64]
    projection: NDArray[np.float64]
    center: NDArray[np.float64]


def metres_per_unit(views: Iterable[View], side: float, capture: Path) -> float:
    """How many metres a unit of the views' world has.

    Args:
        views: are looked at one after the other.
        side: of every tag, outside of its black frame, in metres.
        capture: for messages.

    Raises:
        InputError: no tag is shown by two photographs from different places, or what they say disagrees.
    """
    sightings: dict[int, list[Sighting]] = defaultdict(list)
    count = 0
    for view in views:
        count += 1
        for tag in find_tags(view.image):
            sightings[tag.number].append(_sighting(view, tag.corners))
    if not sightings:
        raise InputError(
            f"none of {count} photographs shows a tag that can be read ({capture})",
            where=WHERE,
            remedy="print the sheet of scripts/scale_sheet.py and photograph it from near, or give two points",
        )
    measured = {number: _side_of(number, seen) for number, seen in sorted(sightings.items()) if _has_depth(seen)}
    if not measured:
        names = ", ".join(map(str, sorted(sightings)))
        raise InputError(
            f"tag {names} is not shown by two photographs from different places ({capture})",
            where=WHERE,
            remedy="photograph it from several sides",
        )
    sides = np.array(list(measured.values()))
    if sides.max() / sides.min() > 1.0 + _UNEVEN:
        said = ", ".join(f"{number}: {side / length:.4g} m a unit" for number, length in measured.items())
        raise InputError(f"the tags disagree ({said})", where=WHERE, remedy="print them all in one size")
    return float(side / np.median(sides))


def _sighting(view: View, corners: NDArray[np.float64]) -> Sighting:
    camera = view.camera
    lens = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    return Sighting(corners, lens @ view.world_to_camera[:3], view.center)


def _has_depth(seen: Sequence[Sighting]) -> bool:
    """Whether the photographs were taken from places different enough."""
    if len(seen) < _LEAST_VIEWS:
        return False
    middle = _intersection(seen, [sighting.corners.mean(axis=0) for sighting in seen])
    rays = np.array([sighting.center for sighting in seen]) - middle
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    return float(np.arccos(np.clip((rays @ rays.T).min(), -1.0, 1.0))) >= _LEAST_ANGLE


def _side_of(number: int, seen: Sequence[Sighting]) -> float:
    """Mean length of the tag's sides, in units of the world.

    Raises:
        InputError: the photographs disagree, or what they show is no square.
    """
    corners, used = _corners(seen)
    for _ in range(len(seen) - 1):  # one stays, whatever it is worth
        agreeing = [sighting for sighting in used if _off(sighting, corners) <= _OFF]
        if len(agreeing) == len(used):
            break
        # One that is wrong pulls the others along, so the worst goes first.
        worst = max(used, key=lambda sighting: _off(sighting, corners))
        corners, used = _corners([sighting for sighting in used if sighting is not worst])
    if len(used) < max(_LEAST_VIEWS, _LEAST_AGREEING * len(seen)):
        what = f"{len(seen)} photographs show tag {number}, and only {len(used)} agree on where it is"
        remedy = "leave it where it is while photographing, use each number once, and look at the cameras"
        raise InputError(what, where=WHERE, remedy=remedy)
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
    diagonals = np.linalg.norm(corners[:2] - corners[2:], axis=1) / np.sqrt(2.0)
    lengths = np.concatenate([sides, diagonals])
    if lengths.max() > (1.0 + _UNEVEN) * lengths.min():
        said = " to ".join(f"{length:.4g}" for length in (lengths.min(), lengths.max()))
        what = f"tag {number} comes out as no square (sides of {said} units)"
        raise InputError(what, where=WHERE, remedy="lay it flat, and photograph it from nearer")
    return float(sides.mean())


def _corners(seen: Sequence[Sighting]) -> tuple[NDArray[np.float64], list[Sighting]]:
    """(4, 3) in the world, and what they were made of."""
    places = [_intersection(seen, [sighting.corners[corner] for sighting in seen]) for corner in range(4)]
    return np.array(places), list(seen)


def _intersection(seen: Sequence[Sighting], pixels: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(3,) nearest to where all rays meet, by distances in pixels (Hartley and Zisserman 2004, 12.2, reweighted)."""
    weights = np.ones(len(seen))
    place = np.zeros(4)
    for _ in range(4):
        rows = [
            weight * (pixel[axis] * sighting.projection[2] - sighting.projection[axis])
            for sighting, pixel, weight in zip(seen, pixels, weights, strict=True)
            for axis in range(2)
        ]
        place = np.linalg.svd(np.array(rows))[2][-1]
        place = place / (place[3] if abs(place[3]) > 1e-12 else 1e-12)
        weights = np.array([1.0 / max(abs(float(sighting.projection[2] @ place)), 1e-9) for sighting in seen])
    return place[:3]


def _off(sighting: Sighting, corners: NDArray[np.float64]) -> float:
    """The largest distance in pixels between the corners and where they were seen."""
    shown = np.column_stack([corners, np.ones(4)]) @ sighting.projection.T
    if (shown[:, 2] <= 0.0).any():
        return np.inf
    return float(np.linalg.norm(shown[:, :2] / shown[:, 2:] - sighting.corners, axis=1).max())
