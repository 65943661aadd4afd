"""What the photographs of a scene are of, where they go around one thing: a sphere to crop the scene to. numpy only.

The centre is the point that is nearest to all viewing axes (least squares); the radius is what cameras at the usual
distance have of it in the middle of their pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from ..errors import InputError
from .gaussians import Gaussians
from .scene_frame import nearest_to_axes

# Degrees between a view's axis and the subject, root mean square: with more it is a place, not a thing.
_MOST_OFF_AXIS = 12.0
_LEAST_SPREAD = 15.0  # degrees between the directions from which it is seen (RMS from their mean)
_SHARE_OF_VIEW = 0.9  # of the narrower half field of view that the subject reaches to
_MOST_RADIUS = 0.8  # of the nearest camera's distance
_LEAST_KEPT, _MOST_KEPT = 0.02, 0.95  # of the Gaussians, between which a crop is worth proposing


@dataclass(frozen=True)
class Subject:
    """A sphere in world units.

    Attributes:
        center: (3,).
        radius: above 0.
    """

    center: NDArray[np.float64]
    radius: float

    @classmethod
    def parse(cls, text: str) -> Subject:
        """The sphere of ``x,y,z radius``, as `__str__` gives it.

        Raises:
            InputError: it is something else.
        """
        try:
            place, length = text.split()
            center, radius = np.array([float(number) for number in place.split(",")]), float(length)
        except ValueError:
            center, radius = np.zeros(0), math.nan
        if center.shape != (3,) or not np.isfinite(center).all() or not 0.0 < radius < math.inf:
            remedy = 'give a centre and a radius in units of the file, as in "0,0.5,0 1.2"'
            raise InputError(f"{repr(text)[:60]} is no sphere", where="--crop", remedy=remedy)
        return cls(center, radius)

    def __str__(self) -> str:
        step = self.radius / 1000.0
        return f"{','.join(f'{round(value / step) * step:.6g}' for value in self.center.tolist())} {self.radius:.4g}"

    def holds(self, gaussians: Gaussians) -> NDArray[np.bool_]:
        """(N,) whose middles lie inside."""
        inside: NDArray[np.bool_] = np.linalg.norm(gaussians.means - self.center, axis=1) <= self.radius
        return inside


def find_subject(views: Sequence[View], gaussians: Gaussians) -> Subject | None:
    """What the views go around, or None where they look at many places or a crop would change next to nothing."""
    if not views:
        return None
    axes = np.stack([view.world_to_camera[2, :3] for view in views])
    centers = np.stack([view.center for view in views])
    focus = nearest_to_axes(centers, axes)
    if focus is None:
        return None
    directions = focus - centers
    distances = np.linalg.norm(directions, axis=1)
    if not (distances > 0.0).all():
        return None
    directions /= distances[:, None]
    mean = directions.mean(axis=0)
    spread = _rms_degrees(directions @ (mean / max(float(np.linalg.norm(mean)), 1e-12)))
    if _rms_degrees((directions * axes).sum(axis=1)) > _MOST_OFF_AXIS or spread < _LEAST_SPREAD:
        return None
    half = [math.atan(min(v.camera.width / v.camera.fx, v.camera.height / v.camera.fy) / 2.0) for v in views]
    reach = float(np.median(distances)) * math.sin(_SHARE_OF_VIEW * float(np.median(half)))
    subject = Subject(focus, min(reach, _MOST_RADIUS * float(distances.min())))
    share = float(subject.holds(gaussians).mean()) if len(gaussians) else 0.0
    return subject if _LEAST_KEPT <= share <= _MOST_KEPT else None


def _rms_degrees(cosines: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))) ** 2)))
