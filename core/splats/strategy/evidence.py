"""What is known about every Gaussian when the set of them is to change. numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]

SEEN_PIXELS = 0.05
"""Pixels of weight from which a view shows a Gaussian: less is the far tail of a footprint."""


@dataclass(frozen=True)
class ViewEvidence:
    """What some training views say about N Gaussians.

    Attributes:
        views: how many were asked.
        complete: whether these are all training views, so that what none of them shows is not needed.
        seen: (N,) views that show the Gaussian.
        votes: (N,) views whose fit is bad where they show it.
        blame: (N,) sum over those views and their pixels of w_jk |I_j - Î_j|: Eq. 8 of Hu and Xiao (2026), of views
            that complain.
        weight: (N,) the largest sum of blend weights w_jk over the pixels of a view: as many pixels show it at best.
        nearness: (N,) distance from the camera of that view, relative to the median of what the view shows.
    """

    views: int
    complete: bool
    seen: Integers
    votes: Integers
    blame: Floats
    weight: Floats
    nearness: Floats


@dataclass(frozen=True)
class Evidence:
    """What the trainer has gathered since the last refinement; None is what the strategy did not ask for.

    Attributes:
        gradient: (N,) mean screen-space gradient norm (`Gradients.screen_abs`).
        views: of the training views rendered for this refinement.
    """

    gradient: Floats | None = None
    views: ViewEvidence | None = None


class ViewEvidenceSum:
    """Adds up what one view after the other says about `count` Gaussians; memory does not grow with the views."""

    def __init__(self, count: int) -> None:
        self._views = 0
        self._seen = np.zeros(count, np.int32)
        self._votes = np.zeros(count, np.int32)
        self._blame = np.zeros(count, np.float32)
        self._weight = np.zeros(count, np.float32)
        self._nearness = np.full(count, np.inf, np.float32)

    def add(self, weight: Floats, error: Floats, threshold: float, distance: Floats) -> None:
        """One view.

        Args:
            weight: (N,) sum of the blend weights over its pixels.
            error: (N,) sum of blend weight times error over its pixels.
            threshold: mean error above which it calls a Gaussian badly fitted.
            distance: (N,) of the Gaussians from its camera.
        """
        self._views += 1
        seen = weight > SEEN_PIXELS
        bad = seen & (error > threshold * weight)
        self._seen += seen
        self._votes += bad
        self._blame += np.where(bad, error, np.float32(0.0))
        best = weight > self._weight
        if seen.any():
            typical = max(float(np.median(distance[seen])), 1e-30)
            self._nearness[best] = distance[best] / typical
        self._weight[best] = weight[best]

    def evidence(self, complete: bool) -> ViewEvidence:
        """All that was added."""
        return ViewEvidence(self._views, complete, self._seen, self._votes, self._blame, self._weight, self._nearness)
