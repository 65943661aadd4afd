"""Whether a capture lies so far from the origin of its world that single precision blurs it. numpy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .source import SourceModel

_ROUNDING = 2.0**-24  # of a float32, relative; splat files and sparse points have such coordinates
_MOST_ROUNDING = 1e-4  # of the extent; across a photograph of some thousand pixels, a fraction of one
_ONE_PLACE = 1e-9  # of the distance; beyond that, cameras differ by the rounding of their poses alone


def warn_about_origin(model: SourceModel) -> None:
    """Note where the capture's distance from the origin costs visible detail; its points have to be finite."""
    centers = np.array([-view.world_to_camera[:3, :3].T @ view.world_to_camera[:3, 3] for view in model.views])
    middle = centers.mean(axis=0)
    distance = float(np.linalg.norm(middle))
    extent = float(_distances(centers, middle).max())
    if len(model.points):  # a panorama's cameras share one place
        extent = max(extent, float(np.median(_distances(model.points, middle))))
    if extent > _ONE_PLACE * distance and distance * _ROUNDING > _MOST_ROUNDING * extent:
        step = float(np.spacing(np.abs(middle).max().astype(np.float32)))
        model.warn(
            "far-from-origin",
            f"{model.file}: the capture lies {distance:,.0f} units from the origin and is {extent:.3g} in radius; "
            f"splat files round positions there to steps of {step:.2g}, and detail is lost: export it again in "
            "coordinates with the origin near the subject (Metashape: Local Coordinates)",
        )


def _distances(places: NDArray[np.floating], middle: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(places - middle, axis=1)
