"""Finds given camera poses that are far off before a run, by what the photographs have in common.

Poses of trackers drift, and exporters mix up conventions. Where few of the features that neighbouring views share fit
the given poses, another convention that fits is looked for, and else poses are adjusted to the features
(`pose_adjustment`). They are taken if views that are held back gain by it: one small scene is fitted with the given
poses, one with those, and each is seen from its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...capture.model import Capture
from ...capture.upright import find_up
from ...capture.view_matches import ViewMatches, agreement, neighbours, poses_of
from ...runtime.protocol import Reporter, StageSpan
from ..calibration.conventions import best_convention
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
        convention: a reading of `conventions.MEANT`, where that is what was wrong.
        words: for the report; empty if nothing was suspected.
    """

    fitting: float = float("nan")
    poses: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    points: NDArray[np.float32] | None = None
    colors: NDArray[np.uint8] | None = None
    convention: str = ""
    words: str = ""

    @property
    def were_off(self) -> bool:
        """Whether they are replaced."""
        return bool(self.poses)

    def replaced(self, capture: Capture) -> Capture:
        """The capture with what replaces its poses and points."""
        moved = capture.moved(self.poses)
        if self.points is not None and self.colors is not None:
            moved = replace(moved, points=self.points, point_colors=self.colors)
        # With other axes, photographs stand on their heads.
        return replace(moved, up=find_up(poses_of(moved.views), moved.points)) if self.convention else moved


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
        matches, poses = ViewMatches(capture.views, self.seed), poses_of(capture.views)
        share = agreement(matches, poses)
        if share >= _SUSPECTED:
            return GivenPoses(share)
        convention, others, fitting = best_convention(matches, poses, capture.format)
        if fitting >= _SUSPECTED:
            return self._by_convention(capture, fitted, (convention, others, fitting), share, reporter)
        if np.isnan(share):
            return GivenPoses(share)
        return self._by_adjustment(capture, fitted, matches, share, reporter)

    def _by_convention(
        self,
        capture: Capture,
        fitted: Sequence[int],
        found: tuple[str, Sequence[NDArray[np.float64]], float],
        share: float,
        reporter: Reporter,
    ) -> GivenPoses:
        convention, others, fitting = found
        poses = {view.key: pose for view, pose in zip(capture.views, others, strict=True)}
        gain = self._gain(capture, capture.moved(poses), fitted, StageSpan(reporter, STAGE, 0.0, 1.0, MESSAGE))
        trial = f"{_fitting(share)}, {fitting:.0%} {convention}, and that gained {gain:.2f} dB in a trial"
        if not gain >= self.least_gain:
            return GivenPoses(share, words=f"as given: {trial}")
        return GivenPoses(share, poses, convention=convention, words=f"{CORRECTED}: {trial}")

    def _by_adjustment(
        self, capture: Capture, fitted: Sequence[int], matches: ViewMatches, share: float, reporter: Reporter
    ) -> GivenPoses:
        pairs = sorted({pair for near in neighbours(poses_of(capture.views)) for pair in near})
        for number, pair in enumerate(pairs):
            reporter.progress(STAGE, _MATCHED * number / len(pairs), MESSAGE)
            matches.common(pair)
        reporter.progress(STAGE, _MATCHED, "adjusting the camera poses")
        adjusted = adjust_poses(matches, pairs)
        if adjusted is None:
            return GivenPoses(share, words=f"as given: {_fitting(share)}, but too little holds others")
        before, after = _alternatives(capture, adjusted)
        gain = self._gain(before, after, fitted, StageSpan(reporter, STAGE, _MATCHED, 1.0, MESSAGE))
        count = f"{len(adjusted.poses)} of {len(capture.views)}"
        trial = f"{_fitting(share)}, and adjusting {count} to it gained {gain:.2f} dB in a trial"
        if not gain >= self.least_gain:
            return GivenPoses(share, words=f"as given: {trial}")
        poses = {view.key: view.world_to_camera for view in after.views}
        points, colors = (after.points, after.point_colors) if after.points is not capture.points else (None, None)
        return GivenPoses(share, poses, points, colors, words=f"{CORRECTED}: {trial}")

    def _gain(self, before: Capture, after: Capture, fitted: Sequence[int], reporter: Reporter) -> float:
        """dB that views held back gain."""
        first, second = (
            ([capture.views[index] for index in fitted], capture.points, capture.point_colors)
            for capture in (before, after)
        )
        return self.fit.gain(first, second, self.judging, self.seed, partial(reporter.progress, STAGE))


def _fitting(share: float) -> str:
    """The suspicion in words."""
    known = "little" if np.isnan(share) else f"only {share:.0%}"
    return f"{known} of what neighbouring views have in common fits them"


def _alternatives(capture: Capture, adjusted: AdjustedPoses) -> tuple[Capture, Capture]:
    """The capture as given, and with adjusted poses; each with the points of the matches where these are more."""
    moved = capture.moved({capture.views[index].key: pose for index, pose in adjusted.poses.items()})
    if len(capture.points) >= len(adjusted.points):
        return capture, moved
    return (
        replace(capture, points=adjusted.points_before, point_colors=adjusted.colors),
        replace(moved, points=adjusted.points, point_colors=adjusted.colors),
    )
