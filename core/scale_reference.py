"""What ``--scale`` says: two points and the metres between them, or the side of printed tags. Standard library only."""

from __future__ import annotations

import math

from .errors import InputError

_WHERE = "--scale"
_UNITS = (1e-6, 1e6)  # metres
_TAG = "tag:"
_SIDES = (0.005, 5.0)  # metres


def metres_of_points(reference: str) -> float | None:
    """Metres in a unit of the capture's world, from two of its points and the metres between them.

    Args:
        reference: ``x,y,z x,y,z metres``.

    Returns:
        None where `reference` is empty, or is for `tag_side_of`.

    Raises:
        InputError: it is something else, the points are one, or the distance is not above 0.
    """
    if not reference or tag_side_of(reference):
        return None
    try:
        first, second, metres = reference.split()
        start, end = ([float(number) for number in point.split(",")] for point in (first, second))
        distance, length = (math.dist(start, end) if len(start) == len(end) == 3 else math.nan), float(metres)
        scale = length / distance
    except (ValueError, ZeroDivisionError, OverflowError):
        scale = math.nan
    if not _UNITS[0] <= scale <= _UNITS[1]:
        remedy = (
            'give two points and the metres between them, as in "0,0,0 0,1.5,0 2.4", or the side of a tag, tag:0.15'
        )
        raise InputError(f"{repr(reference)[:60]} is no reference", where=_WHERE, remedy=remedy)
    return scale


def tag_side_of(reference: str) -> float | None:
    """The side in metres of printed tags, from ``tag:0.15``; None where `reference` is something else.

    Raises:
        InputError: the side is no length that a tag has.
    """
    if not reference.startswith(_TAG):
        return None
    try:
        side = float(reference.removeprefix(_TAG))
    except ValueError:
        side = math.nan
    if not _SIDES[0] <= side <= _SIDES[1]:
        remedy = f"give {_SIDES[0]} to {_SIDES[1]} metres, as in tag:0.15"
        raise InputError(f"{repr(reference)[:60]} is no side of a tag", where=_WHERE, remedy=remedy)
    return side
