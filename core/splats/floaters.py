"""How much each Gaussian looks like a floater, and a scene without those that do. numpy only.

A score is the largest of four terms, each 0 up to a value that sound Gaussians have, 1 from one that only floaters
have, and linear in the value's logarithm in between:

    far       the distance from the scene's centre, in radii of the part that holds most Gaussians
    needle    how many times as long as wide, and how long, in radii; the smaller of both, since threads are slender too
    unseen    the pixels it fills in the view that shows most of it
    alone     where one view or two show it: how near it is to that camera, in median distances of what the view shows

The last two need views.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .gaussians import Gaussians, core_bounds

PROPERTY = "floater"
"""Of a Gaussian in a run's ``splats.ply``: its score."""

_THREE_SIGMA = 3.0  # half of what is seen of a Gaussian
# Views for each of those that may show a floater, at most so many of them: neighbours hardly differ.
_VIEWS_EACH, _MOST_NEIGHBOURS = 8, 2


@dataclass(frozen=True)
class FloaterTerms:
    """Of each term's value, what is sound and what is a floater for sure.

    Attributes:
        far: in radii of the core. Grounds and walls of the demo end at 2.7.
        slenderness: longest by middle standard deviation. The demo's threads and hems have up to 30, one in a thousand
            more.
        length: three standard deviations, in radii.
        visibility: pixels in the best view; the trainer itself leaves nothing below 0.05.
        nearness: in median distances; the trainer itself removes what one view shows from nearer than 0.3.
    """

    far: tuple[float, float] = (2.5, 10.0)
    slenderness: tuple[float, float] = (10.0, 160.0)
    length: tuple[float, float] = (0.1, 1.0)
    visibility: tuple[float, float] = (0.25, 0.01)
    nearness: tuple[float, float] = (0.6, 0.15)


@dataclass(frozen=True)
class Sightings:
    """What the training views show of N Gaussians.

    Attributes:
        views: number of them.
        seen: (N,) number of those that show a Gaussian.
        pixels: (N,) that it fills in the view that shows most of it.
        nearness: (N,) its distance from that view's camera, by the median of what that view shows.
    """

    views: int
    seen: NDArray[np.int32]
    pixels: NDArray[np.float32]
    nearness: NDArray[np.float32]


def floater_scores(
    gaussians: Gaussians, sightings: Sightings | None = None, terms: FloaterTerms = FloaterTerms()
) -> NDArray[np.float32]:
    """(N,) scores in [0, 1]; see above.

    Args:
        sightings: of the same Gaussians; without any, shape and place alone tell.
    """
    if not len(gaussians):
        return np.zeros(0, np.float32)
    center, radius = core_bounds(gaussians.means)
    shortest_first = np.sort(gaussians.log_scales.astype(np.float64), axis=1)
    slenderness = np.exp(shortest_first[:, 2] - shortest_first[:, 1])
    length = _THREE_SIGMA * np.exp(shortest_first[:, 2]) / radius
    found = [
        _ramp(np.linalg.norm(gaussians.means - center, axis=1) / radius, terms.far),
        np.minimum(_ramp(slenderness, terms.slenderness), _ramp(length, terms.length)),
    ]
    if sightings is not None:
        found.append(_ramp(sightings.pixels, terms.visibility))
        alone = (sightings.seen >= 1) & (sightings.seen <= min(sightings.views // _VIEWS_EACH, _MOST_NEIGHBOURS))
        found.append(np.where(alone, _ramp(sightings.nearness, terms.nearness), 0.0))
    return np.max(found, axis=0).astype(np.float32)


def kept_after(scores: NDArray[np.float32], clean: float) -> NDArray[np.bool_]:
    """(N,) whether a Gaussian stays: its score is at most 1 - `clean`.

    Args:
        scores: (N,) in [0, 1].
        clean: 0 keeps all, 1 only those without any sign of a floater.
    """
    return scores <= np.float32(1.0 - clean)


def _ramp(values: NDArray, ends: tuple[float, float]) -> NDArray[np.float64]:
    """(N,) 0 at the first end and before it, 1 at the second and beyond, linear in the logarithm between."""
    sound, sure = np.log(ends)
    logarithms = np.log(np.maximum(np.nan_to_num(values.astype(np.float64), posinf=1e30), 1e-30))
    return np.clip((logarithms - sound) / (sure - sound), 0.0, 1.0)
