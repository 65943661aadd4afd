"""Chooses a few of many photographs or frames, evenly spread."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

_T = TypeVar("_T")


def evenly_spread(items: Sequence[_T], most: int) -> list[_T]:
    """At most `most` of the items, from the first to the last, in their order; the first alone where one is wanted."""
    places = np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int)
    return [items[place] for place in places]
