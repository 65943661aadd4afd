"""Which Gaussians a scene can do without. numpy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .evidence import ViewEvidence

FLOATER_NEARNESS = 0.3
"""Nearer to its only viewer than this share of the view's median distance, a Gaussian is a blot before the lens."""
FLOATER_VIEWS = 3
"""With fewer views than this, being seen by one says nothing."""


def unseen(views: ViewEvidence) -> NDArray[np.bool_]:
    """(N,) Gaussians that no training view shows: outside every frustum, hidden, or too faint everywhere."""
    return (views.seen == 0) & views.complete


def floaters(views: ViewEvidence) -> NDArray[np.bool_]:
    """(N,) Gaussians that only one of all training views shows, and that hang right before its camera."""
    alone = (views.seen == 1) & (views.nearness < FLOATER_NEARNESS)
    return alone & (views.complete and views.views >= FLOATER_VIEWS)
