"""The Pareto front of what has a cost and a value."""

from __future__ import annotations

import math
from collections.abc import Sequence


def pareto_front(costs: Sequence[float], values: Sequence[float]) -> list[int]:
    """Indices of the points that nothing dominates, the cheapest first.

    A point dominates another when it costs no more and is worth no less, and one of the two is better. What has a NaN
    takes no part. Of equal points all or none are returned.
    """
    taking_part = [i for i in range(len(costs)) if not math.isnan(costs[i]) and not math.isnan(values[i])]
    front: list[int] = []
    for i in sorted(taking_part, key=lambda i: (costs[i], -values[i])):
        equals_last = bool(front) and (costs[i], values[i]) == (costs[front[-1]], values[front[-1]])
        if not front or values[i] > values[front[-1]] or equals_last:
            front.append(i)
    return front
