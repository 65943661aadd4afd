"""What a file of poses may have meant: exporters differ in the axes of a camera and in the direction of its matrix."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...capture.source import OPENGL_TO_OPENCV
from ...capture.view_matches import ViewMatches, agreement

Pose = NDArray[np.float64]

_AXES = OPENGL_TO_OPENCV
_TURNED_AXES = ("if y and z of the cameras point the other way", lambda pose: _AXES @ pose)
MEANT: Mapping[str, Sequence[tuple[str, Callable[[Pose], Pose]]]] = {
    "transforms": (
        _TURNED_AXES,
        ("if the matrices go from world to camera", lambda pose: np.linalg.inv(pose) @ _AXES),
        (
            "if the matrices go from world to camera, with OpenGL's axes",
            lambda pose: _AXES @ np.linalg.inv(pose) @ _AXES,
        ),
    ),
    "colmap": (_TURNED_AXES, ("if the poses go from camera to world", np.linalg.inv)),
}
"""By the format of a capture, in words and as a function: what makes right (4, 4) world-to-camera poses, OpenCV axes,
of those that were read. A transforms.json should go from camera to world with OpenGL's axes, COLMAP's poses from world
to camera with OpenCV's."""


def best_convention(matches: ViewMatches, poses: Sequence[Pose], format_: str) -> tuple[str, list[Pose], float]:
    """The reading of poses that what the views have in common fits best, besides the one that is given.

    Args:
        format_: of the capture; one that `MEANT` does not name has one reading alone.

    Returns:
        The reading in words, the (4, 4) poses, and the share that fits them; NaN where none can be told.
    """
    best: tuple[str, list[Pose], float] = ("", [], np.nan)
    for words, change in MEANT.get(format_, ()):
        changed = [change(pose) for pose in poses]
        share = agreement(matches, changed)
        if np.isnan(best[2]) or share > best[2]:
            best = words, changed, share
    return best
