"""Finds given camera poses that are far off before a run, by what the photographs have in common.

Poses of trackers drift, and exporters mix up conventions. Where few of the features that neighbouring views share fit
the given poses, poses are adjusted to them (`pose_adjustment`), and taken if views that are held back gain by it: one
small scene is fitted with the given poses, one with those, and each is seen from its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...capture.model import Capture, View
from ...capture.view_matches import ViewMatches, agreement, neighbours
from ...runtime.protocol import Reporter, StageSpan
from ..calibration.corrections import CORRECTED
from ..calibration.pose_adjustment import AdjustedPoses, adjust_poses
from .lens import STAGE
from .short_fit import ShortFit

GIVEN_POSES = "given_poses"
"""Its key among the decisions of a report."""

MESSAGE = "checking the camera poses"

_SUSPECTED = 0.8  # share of what neighbouring views have in common, below which poses do not fit it
_MATCHED = 0.4  # of the progress, when pairs are matched, and the trial begins


@dataclass(frozen=True)
class GivenPoses:
    """The result of a check.

    Attributes:
        fitting: share of what neighbouring views have in common that fits the given poses; NaN if that is not known.
        poses: (4, 4) world-to-camera by the keys of views; those that replace the given ones.
        points: (P, 3) and `colors`, (P, 3) sRGB, that replace the sparse points; None leaves them.
        words: for the report; empty if nothing was suspected.
    """

    fitting: float = float("nan")
    poses: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    points: NDArray[np.float32] | None = None
    colors: NDArray[np.uint8] | None = None
    words: str = ""

    @property
    def were_off(self) -> bool:
        """Whether they are replaced."""
        return bool(self.poses)

    def replaced(self, capture: Capture) -> Capture:
        """The capture with what replaces its poses and points."""
        moved = capture.moved(self.poses)
        if self.points is None or self.colors is None:
            return moved
        return replace(moved, points=self.points, point_colors=self.colors)


@dataclass(frozen=True)
class PoseCheck:
    """Checks the given poses of a capture.

    Attributes:
        fit: of the trial's scenes.
        judging: one view in so many is held back in a trial.
        least_gain: dB that these views have to gain by other poses.
        seed: of all random numbers.
    """

    fit: ShortFit
    judging: int
    least_gain: float
    seed: int

    def find(self, capture: Capture, fitted: Sequence[int], reporter: Reporter) -> GivenPoses:
        """Look at the views of a capture; only those with the indices `fitted` take part in a trial.

        Args:
            reporter: receives the progress.
        """
        matches = ViewMatches(capture.views, self.seed)
        share = agreement(matches)
        if not share < _SUSPECTED:
            return GivenPoses(share)
        pairs = sorted({pair for near in neighbours(capture.views) for pair in near})
        for number, pair in enumerate(pairs):
            reporter.progress(STAGE, _MATCHED * number / len(pairs), MESSAGE)
            matches.common(pair)
        suspicion = f"{share:.0%} of what neighbouring views have in common fit them"
        adjusted = adjust_poses(matches, pairs)
        if adjusted is None:
            return GivenPoses(share, words=f"as given: only {suspicion}, but too little holds others")
        before, after = _alternatives(capture, adjusted)
        gain = self._gain(before, after, fitted, StageSpan(reporter, STAGE, _MATCHED, 1.0, MESSAGE))
        trial = f"and adjusting {len(adjusted.poses)} of {len(capture.views)} to it gained {gain:.2f} dB in a trial"
        if not gain >= self.least_gain:
            return GivenPoses(share, words=f"as given: only {suspicion}, {trial}")
        poses = {view.key: view.world_to_camera for view in after.views}
        points, colors = (after.points, after.point_colors) if after.points is not capture.points else (None, None)
        return GivenPoses(share, poses, points, colors, f"{CORRECTED}: only {suspicion}, {trial}")

    def _gain(self, before: Capture, after: Capture, fitted: Sequence[int], reporter: Reporter) -> float:
        """dB that views held back gain."""
        psnr = []
        for number, capture in enumerate((before, after)):
            span = StageSpan(reporter, STAGE, number / 2.0, (number + 1) / 2.0, MESSAGE)
            views: list[View] = [capture.views[index] for index in fitted]
            taken = (views, capture.points, capture.point_colors, self.judging, self.seed)
            psnr.append(self.fit.judged(*taken, partial(span.progress, STAGE)))
        return psnr[1] - psnr[0]


def _alternatives(capture: Capture, adjusted: AdjustedPoses) -> tuple[Capture, Capture]:
    """The capture as given, and with adjusted poses; each with the points of the matches where these are more."""
    moved = capture.moved({capture.views[index].key: pose for index, pose in adjusted.poses.items()})
    if len(capture.points) >= len(adjusted.points):
        return capture, moved
    return (
        replace(capture, points=adjusted.points_before, point_colors=adjusted.colors),
        replace(moved, points=adjusted.points, point_colors=adjusted.colors),
    )
