"""The views that decide about a run, and its curve: what is measured on the way, and never fitted."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture.model import View
from ...files.states import SavedState, State
from ..calibration.corrections import ViewCorrections
from ..calibration.poses import AlignedViews
from ..raster import ParameterSet
from ..targets import TrainingView
from .fitting import Fit

Preparer = Callable[[Sequence[View]], list[TrainingView]]
Aligner = Callable[[Sequence[TrainingView]], AlignedViews]
_NO_LINE = np.full(2, np.nan)  # stands for None in a snapshot


class Validation:
    """Views that are measured until validation ends, in poses that match the scene where the given ones are off.

    Args:
        views: that decide; may be empty.
        aligner: aligns views with a scene.

    Attributes:
        views: in their current poses; none after the end.
    """

    def __init__(self, views: Sequence[TrainingView], aligner: Aligner) -> None:
        self.views = list(views)
        self._aligner = aligner
        self._aligned: AlignedViews | None = None

    def __bool__(self) -> bool:
        return bool(self.views)

    @property
    def poses(self) -> NDArray[np.float64] | None:
        """(V, 4, 4) world-to-camera in frame units, or None if they are as given."""
        return None if self._aligned is None else self._aligned.poses

    def align(self, scene: ParameterSet) -> None:
        """Align the views, which are off like the others, with the current scene."""
        if self._aligned is None:
            self._aligned = self._aligner(self.views)
        self._aligned.align(scene)
        self.views = self._aligned.views

    def follow(self, fit: Fit, corrections: ViewCorrections) -> None:
        """Measure views in the poses and through the lines that suit the current scene, where these are corrected."""
        if corrections.poses_were_off:
            self.align(fit.parameters)
        if corrections.blur.active:
            self.views = fit.smeared(self.views)

    def matched(self, scene: ParameterSet, reduction: int) -> list[TrainingView]:
        """The views from where they match a scene best, reduced by a factor, for a trial: the poses of `views` stay."""
        aligned = self._aligner(self.views)
        aligned.align_roughly(scene, reduction)
        return aligned.views

    def leave_out(self, regions: Mapping[int, NDArray[np.bool_]]) -> None:
        """Look no longer at (H, W) regions of views, by their indices."""
        self.views = [view.without(regions.get(index)) for index, view in enumerate(self.views)]
        if self._aligned is not None:
            self._aligned.leave_out(regions)

    def end(self) -> None:
        """Measure nothing from now on."""
        self.views = []

    def snapshot(self) -> State:
        """What `restore` continues from."""
        state: dict[str, Any] = {"ended": not self.views}
        if self._aligned is not None:
            state["aligned"] = self._aligned.snapshot()
        if any(view.smear is not None for view in self.views):
            state["smears"] = np.array([_NO_LINE if view.smear is None else view.smear for view in self.views])
        return state

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`, before anything was aligned; raises `InputError` where it is of other views."""
        if "aligned" in saved:
            self._aligned = self._aligner(self.views)
            self._aligned.restore(saved.part("aligned"))
            self.views = self._aligned.views
        if "smears" in saved:
            lines = saved.array("smears", np.float64, len(self.views), 2)
            smears = [None if np.isnan(line).any() else line for line in lines]
            self.views = [replace(view, smear=smear) for view, smear in zip(self.views, smears, strict=True)]
        if saved.value("ended", bool):
            self.end()


class Curve:
    """What a run has measured so far, and its clock, which stands still meanwhile.

    Attributes:
        entries: as `TrainingResult.curve`.
    """

    def __init__(self) -> None:
        self.entries: list[dict[str, float | None]] = []
        self._started = time.perf_counter()
        self._measuring = 0.0

    @property
    def seconds(self) -> float:
        """Of the run, without the measurements."""
        return time.perf_counter() - self._started - self._measuring

    def extend(self, measure: Callable[[], dict[str, float | None]]) -> float | None:
        """Add an entry, by what `measure` gives of it; returns its PSNR."""
        started = time.perf_counter()
        entry = measure()
        self._measuring += time.perf_counter() - started
        self.entries.append({**entry, "seconds": round(self.seconds, 2)})
        return entry["psnr"]

    def snapshot(self) -> State:
        """What `restore` continues from."""
        return {"entries": self.entries, "seconds": self.seconds}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is damaged."""
        entries = saved.value("entries", list)
        if not entries:
            saved.refuse("entries are missing")
        for entry in entries:
            usable = isinstance(entry, dict) and {"step", "psnr", "gaussians", "seconds"} <= entry.keys()
            if not usable or not all(value is None or type(value) in (int, float) for value in entry.values()):
                saved.refuse("entries are unusable")
        self.entries = entries
        self._started = time.perf_counter() - self._measuring - saved.value("seconds", float)


def curve_entry(
    fit: Fit,
    step: int,
    shown: Sequence[TrainingView],
    deciding: Sequence[TrainingView],
    *,
    any_exposure: bool,
    any_blur: bool,
) -> dict[str, float | None]:
    """What the curve says of `step`, without the time.

    Args:
        shown: held-out views of the curve.
        deciding: training views that validate.
        any_exposure, any_blur: whether the scene is kept free of the photographs' exposures and motion blur.
    """
    entry: dict[str, float | None] = {"step": step, "psnr": fit.psnr(shown) if shown else None, "gaussians": len(fit)}
    if deciding:
        entry["deciding_psnr"] = fit.psnr(deciding, any_exposure=any_exposure)  # the name in existing reports
    if shown and any_exposure:
        entry["psnr_any_exposure"] = fit.psnr(shown, any_exposure=True)
    if shown and any_blur:
        entry["psnr_any_blur"] = fit.psnr(fit.smeared(shown))
    return entry


class HeldOut:
    """The views that nothing is fitted to, of which some make the curve; aligned with the finished scene if need be.

    Args:
        given: all of them.
        prepare: makes targets of views.
        subset: those of the curve.

    Attributes:
        shown: targets of the curve's views.
        poses: (4, 4) world-to-camera in frame units by view key, once they were aligned.
        smears: (2,) lines by view key, once they were found.
    """

    def __init__(self, given: Sequence[View], prepare: Preparer, subset: Callable[[Sequence[Any]], list[Any]]) -> None:
        self._given, self._prepare, self._subset = list(given), prepare, subset
        self.shown: list[TrainingView] = prepare(subset(given))
        self.poses: dict[str, NDArray[np.float64]] = {}
        self.smears: dict[str, NDArray[np.float64]] = {}

    def align(self, scene: ParameterSet, aligner: Aligner) -> None:
        """Align their poses, which are off like the others, with the finished scene."""
        if self._given:
            aligned = aligner(self._prepare(self._given))
            aligned.align(scene)
            self.poses = {view.key: pose for view, pose in zip(self._given, aligned.poses, strict=True)}
            self.shown = self._subset(aligned.views)

    def smear(self, best_line: Callable[[TrainingView], NDArray[np.float64]]) -> None:
        """Find the lines along which the photographs are smeared; what is `shown` is measured as it is."""
        views = self._prepare(self._given)
        if self.poses:
            views = [view.moved(self.poses[given.key]) for view, given in zip(views, self._given, strict=True)]
        self.smears = {given.key: best_line(view) for view, given in zip(views, self._given, strict=True)}
