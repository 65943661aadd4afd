"""Things that move while photographs are taken: found by what the other views show there, and left out if that helps.

A pixel is suspected where a view differs from the scene by far more than it usually does, while views from elsewhere,
that see the same place, do not (residuals in the spirit of Sabour et al. 2023, "RobustNeRF"; here, other views have to
witness against a pixel, so that detail which the scene does not show yet is not taken for something that moves). Two
short fits from the same Gaussians, with and without what was found, decide by views that neither is fitted to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...files.states import SavedState, State
from ...intake.sampling import evenly_spread
from ..calibration.corrections import KnownBlur, ViewCorrections
from ..calibration.motion_blur import smeared_array
from ..raster import ParameterSet, RasterCamera, Rasterizer
from ..targets import Background, TrainingView, ViewOrder
from .fitting import Fit
from .plan import MovingPlan, Region, TrainingPlan
from .schedule import TrainingSchedule
from .validation import Validation

_OPAQUE = 0.5  # alpha from which a view's depth is that of a surface
_PEAKS = 0.02  # of a region's pixels, that are beyond `MovingPlan.outlying`


class MovingThings:
    """What moves in the views of one run, as far as it is known.

    Args:
        rasterizer, background: of the run.
        plan: of the run; without one of things that move, nothing is looked for.
        targets: of the run; what moves is left out of these very views.
        fitted: number of those that are fitted while validation lasts.
        validation: views that decide, which may be further targets, or others.

    Attributes:
        regions: what is left out, by the index of the view: those that are fitted, and then those that validate.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        background: Background,
        plan: TrainingPlan,
        targets: list[TrainingView],
        fitted: int,
        validation: Validation,
    ) -> None:
        self._rasterizer, self._background, self._ssim_weight = rasterizer, background, plan.ssim_weight
        self._targets, self._fitted, self._validation = targets, fitted, validation
        self._plan = plan.moving or MovingPlan()
        self._looks = list(plan.moving.looks) if plan.moving else []
        self._steps = self._plan.trial_steps(plan.steps)
        self.regions: dict[int, Region] = {}
        self._words = ""

    def look_if_due(
        self, step: int, schedule: TrainingSchedule, parameters: ParameterSet, corrections: ViewCorrections
    ) -> bool:
        """Look at the moments of the plan; returns whether views changed, and with them what is measured.

        Nothing else of the run is changed, and no random number of it is used.

        Args:
            step, schedule: of the run.
            parameters: the current Gaussians.
            corrections: of the targets.
        """
        late = [look for look in self._looks if schedule.progress(step) >= look]
        self._looks = self._looks[len(late) :]
        if not late or not self._validation:
            return False
        reduction = schedule.coarsest
        views = [*corrections.seen(range(self._fitted), reduction), *self._validation.views]
        found = find_moving(self._rasterizer, parameters, views, self._background, self._plan, reduction)
        if not any(index < self._fitted for index in found):
            return False
        gain = self._gain(step, schedule, parameters, corrections, views, found)
        trial = f"leaving that out gained {gain:.2f} dB in a trial"
        if gain < self._plan.least_gain:
            self._words = self._words or f"as photographed: in {len(found)} views something stands out, and {trial}"
            return False
        for index, region in found.items():
            self.regions[index] = region | self.regions.get(index, np.zeros_like(region))
        self._words = f"left out: in {len(self.regions)} views something stands out, and {trial}"
        self._leave_out(found)
        return True

    def of_targets(self, keys: Sequence[str]) -> dict[str, Region]:
        """The regions of targets by the keys of these."""
        return {key: self.regions[index] for index, key in enumerate(keys) if index in self.regions}

    def _gain(
        self,
        step: int,
        schedule: TrainingSchedule,
        parameters: ParameterSet,
        corrections: ViewCorrections,
        views: Sequence[TrainingView],
        found: Mapping[int, Region],
    ) -> float:
        """dB that validating views gain where `found` is left out, by two short fits to the same views in order."""
        reduction, learning_rates = schedule.coarsest, schedule.learning_rates(step)
        without = [view.without(found.get(index)).reduced(reduction) for index, view in enumerate(views)]
        judging = without[self._fitted :]
        psnr = []
        for fitted in ([view.reduced(reduction) for view in views], without):
            fit = Fit(self._rasterizer, parameters.to_gaussians(), self._background, self._ssim_weight)
            blur = KnownBlur(self._rasterizer.device, [view.smear for view in fitted])
            order = ViewOrder(self._fitted, np.random.default_rng(step))
            for _ in range(self._steps):
                view = order.next()
                fit.step(fitted[view], 1, learning_rates, correction=blur.of(view))
            psnr.append(fit.psnr(judging, any_exposure=corrections.exposure.active))
        return psnr[1] - psnr[0]

    def _leave_out(self, regions: Mapping[int, Region]) -> None:
        for index, region in regions.items():
            if index < len(self._targets):  # the others are held-out views, which are never fitted
                self._targets[index] = self._targets[index].without(region)
        fitted = self._fitted
        self._validation.leave_out({index - fitted: region for index, region in regions.items() if index >= fitted})

    def in_words(self) -> dict[str, str]:
        """The decision, for the report; empty where nothing was found."""
        return {"moving": self._words} if self._words else {}

    def snapshot(self) -> State:
        """What `restore` continues from."""
        regions = {str(index): region for index, region in self.regions.items()}
        return {"looks": len(self._looks), "words": self._words, "views": sorted(self.regions), "regions": regions}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`, before validation is restored; raises `InputError` where it is of other views."""
        views = [*self._targets[: self._fitted], *self._validation.views]
        left = saved.number("looks", 0, len(self._looks))
        self._looks = self._looks[len(self._looks) - left :]
        self._words = saved.value("words", str)
        for index in saved.value("views", list):
            if type(index) is not int or not 0 <= index < len(views):
                saved.refuse("views is unusable")
            height, width = views[index].at(1)[0].shape[:2]
            self.regions[index] = saved.part("regions").array(str(index), np.bool_, height, width)
        self._leave_out(self.regions)


@dataclass(frozen=True)
class _Seen:
    """A view as the scene shows it; (H, W) arrays of the reduced view."""

    camera: RasterCamera
    excess: NDArray[np.float32]  # residual in medians of its view
    depth: NDArray[np.float32]  # 0 where there is nothing


def find_moving(
    rasterizer: Rasterizer,
    parameters: ParameterSet,
    views: Sequence[TrainingView],
    background: Background,
    plan: MovingPlan,
    reduction: int = 1,
) -> Mapping[int, Region]:
    """What of the views' full images moves, by their indices; views in which nothing does are missing.

    Args:
        views: as the scene sees them: in current poses, without exposure differences.
        reduction: factor by which they are reduced for it.
    """
    seen = [_look(rasterizer, parameters, view.reduced(reduction), background, plan) for view in views]
    found = {}
    for index, own in enumerate(seen):
        others = [seen[other] for other in evenly_spread(range(len(seen)), plan.witnesses + 1) if other != index]
        region = _moving_in(own, others, plan)
        if region is not None:
            found[index] = _enlarged(region, views[index].at(1)[0].shape[:2])
    return found


def _enlarged(region: Region, shape: tuple[int, int]) -> Region:
    """In the full image's (H, W); what is cut off from reduced images at the far edges goes with its neighbours."""
    factor = max(shape[0] // region.shape[0], 1)
    full = region.repeat(factor, axis=0).repeat(factor, axis=1)
    return np.pad(full, ((0, shape[0] - full.shape[0]), (0, shape[1] - full.shape[1])), mode="edge")


def _look(
    rasterizer: Rasterizer, parameters: ParameterSet, view: TrainingView, background: Background, plan: MovingPlan
) -> _Seen:
    image, camera = view.at(1)
    frame = rasterizer.render(parameters, camera, background.color)
    color = smeared_array(frame.color.numpy(), view.smear)
    residual = np.abs(color - image.numpy() * np.float32(1.0 / 255.0)).mean(axis=2)
    residual = ndimage.uniform_filter(np.nan_to_num(residual), plan.smooth)
    alpha = frame.alpha.numpy()
    depth = np.where(alpha > _OPAQUE, frame.depth.numpy() / np.maximum(alpha, _OPAQUE), 0.0).astype(np.float32)
    shown = view.looked_at()
    if shown is not None:
        depth, residual = depth * shown, residual * shown
    usual = float(np.median(residual if shown is None else residual[shown])) if shown is None or shown.any() else 0.0
    return _Seen(camera, (residual / max(usual, plan.floor)).astype(np.float32), depth)


def _moving_in(own: _Seen, others: Sequence[_Seen], plan: MovingPlan) -> Region | None:
    """(H, W) of the view, or None."""
    candidates = (own.excess > plan.belonging) & (own.depth > 0.0)
    if not (candidates & (own.excess > plan.outlying)).any():
        return None
    rows, columns = np.nonzero(candidates)
    contradicted = np.zeros_like(candidates)
    contradicted[rows, columns] = _witnessed(own, rows, columns, others, plan)
    contradicted = ndimage.binary_opening(contradicted, np.ones((2, 2)))
    labels, count = ndimage.label(contradicted, np.ones((3, 3)))
    if not count:
        return None
    numbers = np.arange(1, count + 1)
    areas = ndimage.sum_labels(contradicted, labels, numbers)
    peaks = ndimage.sum_labels(own.excess > plan.outlying, labels, numbers)
    enough = (areas >= plan.least_area * contradicted.size) & (peaks >= _PEAKS * areas)
    if not enough.any():
        return None
    region = ndimage.binary_fill_holes(np.isin(labels, numbers[enough]))
    margin = max(1, round(plan.margin * max(region.shape)))
    return ndimage.binary_dilation(region, ndimage.generate_binary_structure(2, 1), margin)


def _witnessed(
    own: _Seen, rows: NDArray[np.int64], columns: NDArray[np.int64], others: Sequence[_Seen], plan: MovingPlan
) -> NDArray[np.bool_]:
    """(n,) whether the views that see the places of these pixels agree with the scene there."""
    camera = own.camera
    depth = own.depth[rows, columns].astype(np.float64)
    x, y = (columns + 0.5 - camera.cx) / camera.fx * depth, (rows + 0.5 - camera.cy) / camera.fy * depth
    to_world = np.linalg.inv(camera.world_to_camera)
    places = np.column_stack([x, y, depth]) @ to_world[:3, :3].T + to_world[:3, 3]
    told = np.full((len(others), len(rows)), np.nan, np.float32)
    for index, other in enumerate(others):
        pose = other.camera.world_to_camera
        x, y, z = (places @ pose[:3, :3].T + pose[:3, 3]).T
        ahead = z > other.camera.near
        safe = np.where(ahead, z, 1.0)
        column = np.floor(other.camera.fx * x / safe + other.camera.cx)
        row = np.floor(other.camera.fy * y / safe + other.camera.cy)
        height, width = other.depth.shape
        inside = ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        at = np.flatnonzero(inside)
        row, column = row[at].astype(int), column[at].astype(int)
        there = other.depth[row, column]
        same = np.abs(there - z[at]) <= plan.same_depth * z[at]
        told[index, at[same]] = other.excess[row[same], column[same]]
    counts = np.isfinite(told).sum(axis=0)
    witnessed = counts >= plan.fewest_witnesses
    result = np.zeros(len(rows), bool)
    if witnessed.any():
        result[witnessed] = np.nanmedian(told[:, witnessed], axis=0) <= plan.agreeing
    return result
