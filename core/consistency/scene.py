"""The correspondences of one scene, each pair of views matched once and kept. numpy only.

The multi-view loss, the weights of what varies with the view and the warping error ask for overlapping pairs; whoever
asks first pays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..events import Reporter
from .correspondence import Correspondences, CorrespondenceSettings, PosedCamera, match_surfaces, trusted_surface

MOST_TRIED_PIXELS = 40_000
"""Of a view: drift and gloss are smooth and more samples change no mean, but time and memory go with their number."""

DepthOfView = Callable[[int], tuple[NDArray[np.float32], NDArray[np.float32]]]
"""Index of a view to its (H, W) planar depth, divided by alpha, and its (H, W) alpha."""


class SceneCorrespondences:
    """Matches pairs of `views` by their depth, on first request.

    Args:
        views: the cameras.
        depth: asked at most once for each view.
        settings: when a correspondence is accepted; None takes the defaults with a stride that tries at most
            `MOST_TRIED_PIXELS` of a view.
    """

    def __init__(
        self, views: Sequence[PosedCamera], depth: DepthOfView, settings: CorrespondenceSettings | None = None
    ) -> None:
        self.views = views
        self.settings = settings or CorrespondenceSettings(stride=_stride(views))
        self._depth = depth
        self._surfaces: dict[int, NDArray[np.float32]] = {}
        self._found: dict[tuple[int, int], Correspondences] = {}

    def between(self, first: int, second: int) -> Correspondences:
        """What the two views both see, from the pixels of the first."""
        if (first, second) not in self._found:
            surfaces = self._surface(first), self._surface(second)
            pixels, positions = match_surfaces(
                surfaces[0], self.views[first], surfaces[1], self.views[second], self.settings
            )
            self._found[first, second] = Correspondences(first, second, pixels, positions)
        return self._found[first, second]

    def of_pairs(
        self, pairs: Sequence[tuple[int, int]], reporter: Reporter | None = None, stage: str = "correspondences"
    ) -> list[Correspondences]:
        """`between` for each pair, with progress under the name of `stage`."""
        reporter = reporter or Reporter()
        found = []
        for number, (first, second) in enumerate(pairs):
            found.append(self.between(first, second))
            reporter.progress(stage, (number + 1) / len(pairs), "matching points between views")
        return found

    def _surface(self, index: int) -> NDArray[np.float32]:
        if index not in self._surfaces:
            depth, alpha = self._depth(index)
            self._surfaces[index] = trusted_surface(depth, alpha, self.settings)
        return self._surfaces[index]


def nearest_views(views: Sequence[PosedCamera], among: Sequence[int], count: int) -> dict[int, list[int]]:
    """For each of the views `among`, the `count` others that look most alike, nearest first.

    Nearness is the distance of the centres, in units of the farthest camera's distance from their mean, plus the angle
    between the viewing directions in radians: either of them changes what is seen.
    """
    poses = [views[index].world_to_camera for index in among]
    centers = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in poses])
    forward = np.stack([pose[2, :3] for pose in poses])
    extent = np.linalg.norm(centers - centers.mean(0), axis=1).max() or 1.0
    distance = np.linalg.norm(centers[:, None] - centers[None], axis=2) / extent
    distance += np.arccos(np.clip(forward @ forward.T, -1.0, 1.0))
    np.fill_diagonal(distance, np.inf)
    order = np.argsort(distance, axis=1, kind="stable")[:, : min(count, len(among) - 1)]
    return {index: [among[other] for other in row] for index, row in zip(among, order, strict=True)}


def _stride(views: Sequence[PosedCamera]) -> int:
    most = max(view.camera.width * view.camera.height for view in views)
    return max(math.ceil(math.sqrt(most / MOST_TRIED_PIXELS)), 1)
