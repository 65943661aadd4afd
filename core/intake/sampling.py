"""How many frames of videos are taken, and a few of many, evenly spread."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

MOST_FRAMES = 150
"""Of all videos of a capture; more take SfM and training longer than they improve them."""

_FRAMES_A_SECOND = 4.0  # of somebody who walks through a bedroom; how many they become depends on how the picture moves

_T = TypeVar("_T")


def likely_frames(seconds: float) -> int:
    """How many frames are likely to be taken of videos of so many seconds, before anybody has looked at them."""
    return min(round(_FRAMES_A_SECOND * seconds), MOST_FRAMES)


def evenly_spread(items: Sequence[_T], most: int) -> list[_T]:
    """At most `most` of the items, from the first to the last, in their order; the first alone where one is wanted."""
    places = np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int)
    return [items[place] for place in places]
