"""Finds a wrong focal length before a run, by fitting a small scene whose cameras may change theirs.

All photographs are assumed to be taken with one lens, so a single factor of all focal lengths is searched for.

A wrong focal length is well hidden: the scene shrinks or stretches until hardly any view contradicts it, and what is
left is a narrow valley of the loss. So the search walks along the valley: whenever the factor changes, the scene moves
by the affine motion that best compensates the change in all views (`compensating_motion`), and the loss reacts to what
cannot be compensated.

Cameras with slightly wrong rotations look like a longer lens, since a smaller scene contradicts itself by fewer pixels.
What the quick first search finds is therefore searched for again, longer, while poses are refined as well. The result
is taken if views that are held back gain by it: one scene is fitted with the given lens and one with that, and each is
seen through its own.

Cut-outs are not checked: without surroundings, a longer lens and a camera farther away look alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...capture.model import View
from ...intake.sampling import evenly_spread
from ...runtime.protocol import Reporter, StageSpan
from ..calibration.adam import AdamMoments, decayed
from ..calibration.corrections import CORRECTED, Correction
from ..calibration.poses import PoseRefinement
from ..calibration.zoom import AffineMotion, compensating_motion, zoom_slope
from ..raster import Gradients, ParameterSet, RasterCamera, Rasterizer
from ..targets import Background, ViewOrder
from .fitting import Fit
from .initialise import InitialGaussians
from .plan import TrainingPlan
from .short_fit import ShortFit

FOCAL_LENGTH = "focal_length"
"""Its key among the decisions of a report."""

STAGE, MESSAGE = "lens", "checking the focal length"

_SAMPLED = 2000  # Gaussians by which a compensating motion is determined
_PROGRESS_EVERY = 10  # steps
_USUAL_SEARCHES = 3  # after the first one, if a lens is off
_TRIAL = 0.75  # of the progress is done when they are, and the trial begins


@dataclass(frozen=True)
class LensSearch:
    """One search, in a scene of its own.

    Attributes:
        steps: of the scene's fit.
        gaussians: largest number of them; they are neither densified nor pruned.
        side: longer side of the views in pixels, about.
        start: fraction of the steps after which the factor moves. An unfinished scene is blurred and asks for a longer
            lens than a sharp one.
        learning_rate: of the factor's logarithm, initially.
        lr_final_factor: factor of the learning rate at the end, reached exponentially.
        refines_poses: whether poses are refined along with the factor.
    """

    steps: int
    gaussians: int
    side: int
    start: float
    learning_rate: float
    lr_final_factor: float = 0.05
    refines_poses: bool = False


@dataclass(frozen=True)
class LensPlan:
    """When a focal length counts as wrong, and how it is found.

    Attributes:
        first: the search that every run begins with, 1 to 3 seconds on two cores. It finds good captures within 0.7 %,
            and half the error of wrong ones, since its scene has not followed by then.
        suspected: log factor from which the second search is made.
        second: 4 to 14 seconds each time. It finds 2 % as 0.9 to 2.2 %, 5 % as 3.1 to 4.6 %, and good lenses within
            0.9 %, also with cameras rotated by up to a degree.
        least: log factor from which the focal length is corrected. An error of 1 % costs a tenth of a decibel.
        rounds: the second search is repeated from its own result, at most this often, while it finds `least` more.
        good_poses: motion of poses, in pixels, up to which they are good: one more search without pose refinement
            then makes the result more exact. 0.1 to 0.4 if they are good, 0.7 and more for rotations of 0.25°. If they
            are not good, nothing is corrected.
        judging: one view in so many judges a trial of the lens that was found, in scenes that the others give.
        least_gain: dB that these views have to gain by it.
        min_residual: share of the change that has to be left after compensation; with less, views cannot tell lenses
            apart.
        fewest_views: with fewer, there is too little to contradict.
        most_views: largest number of views used.
        least_steps: shortest run for which a check is worthwhile.
        pose_learning_rate: initially, an angle of view in radians.
        pose_lr_final_factor: factor of the poses' learning rate at the end, reached exponentially.
        ssim_weight: of the loss of the searches' scenes.
        initial: how the Gaussians are initialised.
    """

    first: LensSearch = LensSearch(400, 6_000, 120, 0.4, 1e-2)
    suspected: float = 0.007
    second: LensSearch = LensSearch(800, 9_000, 240, 0.1, 6e-3, refines_poses=True)
    least: float = 0.01
    rounds: int = 4
    good_poses: float = 0.5
    judging: int = 6
    least_gain: float = 0.1
    min_residual: float = 0.05
    fewest_views: int = 6
    most_views: int = 60
    least_steps: int = 300
    pose_learning_rate: float = 3e-3
    pose_lr_final_factor: float = 0.05
    ssim_weight: float = 0.2
    initial: InitialGaussians = field(default_factory=InitialGaussians)


@dataclass(frozen=True)
class FocalLength:
    """The result of a check.

    Attributes:
        factor: that corrects all focal lengths; 1 if they are left as given.
        words: for the report; empty if there was no check.
    """

    factor: float = 1.0
    words: str = ""

    @property
    def was_off(self) -> bool:
        """Whether it is to be corrected."""
        return self.factor != 1.0

    def after(self, first: FocalLength) -> FocalLength:
        """This one, found with what another one had corrected already."""
        return replace(self, factor=first.factor * self.factor)

    @property
    def error(self) -> str:
        """The error of the given focal length, in words."""
        share = 1.0 / self.factor - 1.0
        return f"{abs(share):.1%} too {'long' if share > 0.0 else 'short'}"


@dataclass(frozen=True)
class LensCheck:
    """Checks the focal length of a capture.

    Attributes:
        rasterizer: renders the views.
        views: training views, all taken with one lens.
        background: behind the Gaussians.
        plan: how to check.
        seed: of all random numbers.
    """

    rasterizer: Rasterizer
    views: Sequence[View]
    background: Background
    plan: LensPlan
    seed: int

    def find(self, points: NDArray[np.float32], colors: NDArray[np.uint8], reporter: Reporter) -> FocalLength:
        """Search from (P, 3) sparse points in world units and their (P, 3) uint8 sRGB colours; P may be 0.

        Args:
            reporter: receives the progress, which falls back if there is more to do than expected.
        """
        plan = self.plan
        cut_out = any(self.background.color)
        if len(self.views) < plan.fewest_views or cut_out:
            return FocalLength()
        given = evenly_spread(self.views, plan.most_views)
        search = partial(self._search, given, points, colors)
        found = search(plan.first, 0.0, StageSpan(reporter, STAGE, 0.0, 1.0, MESSAGE))
        if found is None:
            return FocalLength(words="as given: these views cannot tell")
        if abs(found.logarithm) < plan.suspected:
            return found.as_given
        again = self._search_again(search, reporter)
        if again.logarithm * found.logarithm < 0.0 or abs(again.logarithm) < plan.least:
            return again.as_given
        if again.motion > plan.good_poses:
            return FocalLength(words="as given: it cannot be told from wrong camera poses")
        factor = math.exp(again.logarithm)
        seems = FocalLength(factor).error
        span = StageSpan(reporter, STAGE, _TRIAL, 1.0, MESSAGE)
        before, after = ((views, points, colors) for views in (given, _through(given, factor)))
        gain = self._fit(plan.second).gain(before, after, plan.judging, self.seed, partial(span.progress, STAGE))
        trial = f"and correcting that gained {gain:.2f} dB in a trial"
        if gain < plan.least_gain:
            return FocalLength(words=f"as given: it seems {seems}, {trial}")
        return FocalLength(factor, f"{CORRECTED}: it was {seems}, {trial}")

    def _search_again(
        self, search: Callable[[LensSearch, float, Reporter], _Found | None], reporter: Reporter
    ) -> _Found:
        """The longer searches, each from the result of the one before; the last one leaves poses alone."""
        plan, found = self.plan, _Found(0.0, 0.0)
        ends = [_TRIAL * min(number / _USUAL_SEARCHES, 1.0) for number in range(plan.rounds + 2)]
        spans = [StageSpan(reporter, STAGE, start, end, MESSAGE) for start, end in pairwise(ends)]
        for span in spans[:-1]:
            found = search(plan.second, found.logarithm, span) or found
            if abs(found.step) < plan.least:
                break
        if abs(found.logarithm) < plan.least or found.motion > plan.good_poses:
            return found
        return search(replace(plan.second, refines_poses=False), found.logarithm, spans[-1]) or found

    def _search(
        self,
        views: Sequence[View],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
        search: LensSearch,
        logarithm: float,
        reporter: Reporter,
    ) -> _Found | None:
        """Search from the factor of this logarithm; None if the views cannot tell one lens from another."""
        plan, training, rng = self.plan, TrainingPlan(), np.random.default_rng(self.seed)
        targets, gaussians = self._fit(search).prepare(_through(views, math.exp(logarithm)), points, colors, rng)
        if not len(gaussians):
            return None
        cameras = [view.at(1)[1] for view in targets]
        sampled = rng.permutation(len(gaussians))[:_SAMPLED]
        motion = compensating_motion(gaussians.means[sampled].astype(np.float64), cameras)
        if motion.residual < plan.min_residual:
            return None
        fit = Fit(self.rasterizer, gaussians, self.background, plan.ssim_weight)
        poses = PoseRefinement([camera.world_to_camera for camera in cameras])
        lens, order = _MovingLens(search, plan, motion, poses), ViewOrder(len(targets), rng)
        for step in range(search.steps):
            progress, view = step / search.steps, order.next()
            learning_rates = training.learning_rates_at(progress)
            fit.step(targets[view], 1, learning_rates, correction=lens.of(view, progress))
            if step % _PROGRESS_EVERY == 0:
                reporter.progress(STAGE, progress)
        return _Found(logarithm + lens.logarithm, lens.logarithm, poses.image_motion(cameras))

    def _fit(self, search: LensSearch) -> ShortFit:
        size = (search.steps, search.gaussians, search.side)
        return ShortFit(self.rasterizer, self.background, *size, self.plan.ssim_weight, self.plan.initial)


def _through(views: Sequence[View], factor: float) -> list[View]:
    """The views through a lens longer by `factor`."""
    return [replace(view, camera=view.camera.zoomed(factor)) for view in views]


@dataclass(frozen=True)
class _Found:
    """The result of a search.

    Attributes:
        logarithm: of the factor.
        step: its change in this search.
        motion: of the images by refined poses, in pixels.
    """

    logarithm: float
    step: float
    motion: float = 0.0

    @property
    def as_given(self) -> FocalLength:
        """Too little for a correction."""
        return FocalLength(words=f"as given: a rough scene asks for {math.expm1(self.logarithm):+.1%}")


class _MovingLens(Correction):
    """The factor of all focal lengths during a search, and the poses if they are refined."""

    def __init__(self, search: LensSearch, plan: LensPlan, motion: AffineMotion, poses: PoseRefinement) -> None:
        self._search, self._plan, self._motion, self._poses = search, plan, motion, poses
        self._moments = AdamMoments()
        self._view, self._progress = 0, 0.0
        self.logarithm = 0.0

    def of(self, view: int, progress: float) -> Correction:
        """The correction of a view at a fraction of the search."""
        self._view, self._progress = view, progress
        return self

    def camera(self, camera: RasterCamera) -> RasterCamera:
        if self._search.refines_poses:
            camera = self._poses.camera(self._view, camera)
        return camera.zoomed(math.exp(self.logarithm))

    def after_backward(self, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        """Adam steps of the view's pose and of the factor, and the motion of the scene that goes with it."""
        search, plan = self._search, self._plan
        if self._progress < search.start:
            return
        slope = zoom_slope(parameters, gradients, camera) + self._motion.slope(parameters, gradients)
        if not math.isfinite(slope):
            return
        if search.refines_poses:
            pose_rate = decayed(plan.pose_learning_rate, plan.pose_lr_final_factor, self._progress, search.start)
            self._poses.step(self._view, parameters, gradients, camera, pose_rate)
        mean, scale = self._moments.update(slope)
        rate = decayed(search.learning_rate, search.lr_final_factor, self._progress, search.start)
        amount = float(-rate * mean / scale)
        self.logarithm += amount
        self._motion.apply(parameters, amount)
