"""A focal length that is off, found before a run by fitting a small scene whose cameras may change theirs.

One lens is taken to have made all photographs, so a single factor of all focal lengths is looked for.

A wrong one hides: the scene shrinks or stretches until hardly any view contradicts it, and what is left is a narrow
valley of the loss. So the search walks along the valley: whenever the factor changes, the scene moves by the affine
motion that hides the change best from all views (`hiding_motion`), and the loss tells what cannot be hidden.

Cameras that point a little beside their places look like a long lens, since a smaller scene contradicts itself by fewer
pixels. What the quick first search finds is therefore looked at again, longer, with poses that may move as well.

Subjects that are cut out are not asked: with no surroundings, a longer lens and a camera farther away look alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..capture.model import View
from ..events import Reporter, StageSpan
from .corrections import CORRECTED
from .fitting import Fit
from .initialise import InitialGaussians
from .plan import TrainingPlan
from .poses import PoseRefinement
from .raster import Frame, Gradients, ParameterSet, RasterCamera, Rasterizer
from .scene_frame import SceneFrame
from .targets import Background, TrainingView, ViewOrder, prepare_targets
from .zoom import AffineMotion, hiding_motion, zoom_slope

FOCAL_LENGTH = "focal_length"
"""What it is called among the decisions of a report."""

STAGE, MESSAGE = "lens", "checking the focal length"

_BETA_1, _BETA_2 = 0.9, 0.99
_EPSILON = 1e-30
_SAMPLED = 2000  # Gaussians that decide what hides a change best
_PROGRESS_EVERY = 10  # steps
_USUAL_SEARCHES = 3  # after the first one, where a lens is off


@dataclass(frozen=True)
class LensSearch:
    """One search, in a scene of its own.

    Attributes:
        steps: of the scene's fit.
        gaussians: at most so many; they neither grow nor go.
        side: longer side of the views in pixels, about.
        started: fraction of the steps after which the factor moves. An unfinished scene is soft and asks for a longer
            lens than a sharp one.
        rate: step size of the factor's logarithm at first; `rate_left` of it is left at the end.
        moves_poses: whether the cameras move along.
    """

    steps: int
    gaussians: int
    side: int
    started: float
    rate: float
    rate_left: float = 0.05
    moves_poses: bool = False


@dataclass(frozen=True)
class LensPlan:
    """When a focal length is taken to be off, and how that is found.

    Attributes:
        first: the search that every run begins with, 1 to 3 seconds on two cores. Good captures were found within
            0.7 %; of what a lens is off it finds a half, since its scene has not followed by then.
        suspected: what it has to find for the second search.
        second: 4 to 14 seconds each. It finds 2 % as 0.9 to 2.2 %, 5 % as 3.1 to 4.6 %, and good lenses within 0.9 %,
            also of cameras that are turned by up to a degree.
        least: what that has to find for a correction. A lens that is off by 1 % costs a tenth of a decibel.
        rounds: the second search begins anew with what it found, at most so often, as long as it finds `least` more.
        good_poses: where poses moved by less than so many pixels at last, they were good, and one more search without
            moving them makes the result more exact: 0.1 to 0.4 where they are, 0.7 and more for turns of 0.25°. Where
            they were not, nothing is corrected.
        hidden: a capture whose views can hide all but this share of the change does not tell.
        fewest_views: with fewer there is not much to contradict.
        most_views: so many of them are looked at.
        least_steps: of a run that is worth it.
        poses_rate, poses_rate_left: step sizes of poses, an angle of view in radians.
    """

    first: LensSearch = LensSearch(400, 6_000, 120, 0.4, 1e-2)
    suspected: float = 0.007
    second: LensSearch = LensSearch(800, 9_000, 240, 0.1, 6e-3, moves_poses=True)
    least: float = 0.01
    rounds: int = 4
    good_poses: float = 0.5
    hidden: float = 0.05
    fewest_views: int = 6
    most_views: int = 60
    least_steps: int = 300
    poses_rate: float = 3e-3
    poses_rate_left: float = 0.05
    initial: InitialGaussians = field(default_factory=InitialGaussians)


@dataclass(frozen=True)
class FocalLength:
    """What was found out about it.

    Attributes:
        factor: that makes all focal lengths right; 1 where they are left as given.
        words: for the report; empty where nobody looked.
    """

    factor: float = 1.0
    words: str = ""

    @property
    def was_off(self) -> bool:
        """Whether it is to be corrected."""
        return self.factor != 1.0

    @property
    def error(self) -> str:
        """How far it was off, in words."""
        share = 1.0 / self.factor - 1.0
        return f"{abs(share):.1%} too {'long' if share > 0.0 else 'short'}"


@dataclass(frozen=True)
class LensCheck:
    """Looks whether the focal length of a capture is right.

    Attributes:
        rasterizer: does the arithmetic.
        views: to fit; all are taken to be by one lens.
        background: what is behind the Gaussians.
        plan: how to look.
        seed: of everything random.
    """

    rasterizer: Rasterizer
    views: Sequence[View]
    background: Background
    plan: LensPlan
    seed: int

    def find(self, points: NDArray[np.float32], colors: NDArray[np.uint8], reporter: Reporter) -> FocalLength:
        """Search from (P, 3) sparse points in world units and their (P, 3) uint8 sRGB colours; P may be 0.

        Args:
            reporter: told of the progress, which falls back where there is more to do than was expected.
        """
        plan = self.plan
        cut_out = any(self.background.color)
        if len(self.views) < plan.fewest_views or cut_out:
            return FocalLength()
        asked = np.unique(np.linspace(0, len(self.views) - 1, plan.most_views).round().astype(int))
        views = [self.views[i] for i in asked]
        search = partial(self._search, views, points, colors)
        found = search(plan.first, 0.0, StageSpan(reporter, STAGE, 0.0, 1.0, MESSAGE))
        if found is None:
            return FocalLength(words="as given: these views cannot tell")
        if abs(found.logarithm) < plan.suspected:
            return found.as_given
        again = self._found_again(search, reporter)
        if again.logarithm * found.logarithm < 0.0 or abs(again.logarithm) < plan.least:
            return again.as_given
        if again.motion > plan.good_poses:
            return FocalLength(words="as given: cameras that are turned or moved do not tell")
        factor = math.exp(again.logarithm)
        return FocalLength(factor, f"{CORRECTED}: it was {FocalLength(factor).error}")

    def _found_again(
        self, search: Callable[[LensSearch, float, Reporter], _Found | None], reporter: Reporter
    ) -> _Found:
        """What the longer searches find, each from where the one before ended; the last one leaves poses alone."""
        plan, found = self.plan, _Found(0.0, 0.0)
        ends = [min(number / _USUAL_SEARCHES, 1.0) for number in range(plan.rounds + 2)]
        spans = [StageSpan(reporter, STAGE, start, end, MESSAGE) for start, end in pairwise(ends)]
        for span in spans[:-1]:
            found = search(plan.second, found.logarithm, span) or found
            if abs(found.step) < plan.least:
                break
        if abs(found.logarithm) < plan.least or found.motion > plan.good_poses:
            return found
        return search(replace(plan.second, moves_poses=False), found.logarithm, spans[-1]) or found

    def _search(
        self,
        views: Sequence[View],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
        search: LensSearch,
        logarithm: float,
        reporter: Reporter,
    ) -> _Found | None:
        """What a search finds from a factor on; None where the views cannot tell one lens from another."""
        zoomed = [replace(view, camera=view.camera.zoomed(math.exp(logarithm))) for view in views]
        run = _SearchRun.of(self, search, zoomed, points, colors)
        return run.result(logarithm, reporter) if run else None


@dataclass(frozen=True)
class _Found:
    """What a search found.

    Attributes:
        logarithm: of the factor.
        step: of it since the search before.
        motion: by which poses moved what is seen, in pixels.
    """

    logarithm: float
    step: float
    motion: float = 0.0

    @property
    def as_given(self) -> FocalLength:
        """That it is not enough for a correction."""
        return FocalLength(words=f"as given: a rough scene asks for {math.expm1(self.logarithm):+.1%}")


class _MovingLens:
    """The factor of all focal lengths on its way, and the poses if they move."""

    def __init__(self, search: LensSearch, plan: LensPlan, motion: AffineMotion, poses: PoseRefinement) -> None:
        self._search, self._plan, self._motion, self._poses = search, plan, motion, poses
        self._first = self._second = 0.0
        self._moves = 0
        self.logarithm = 0.0

    def camera(self, view: int, camera: RasterCamera) -> RasterCamera:
        """`camera` of `view` as it is now."""
        if self._search.moves_poses:
            camera = self._poses.camera(view, camera)
        return camera.zoomed(math.exp(self.logarithm))

    def move(
        self, view: int, progress: float, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera
    ) -> None:
        """Move the factor, the scene with it, and the view's pose by their gradients, in Adam's way."""
        done = (progress - self._search.started) / (1.0 - self._search.started)
        if done < 0.0:
            return
        slope = zoom_slope(parameters, gradients, camera) + self._motion.slope(parameters, gradients)
        if not math.isfinite(slope):
            return
        if self._search.moves_poses:
            rate = self._plan.poses_rate * self._plan.poses_rate_left**done
            self._poses.step(view, parameters, gradients, camera, rate)
        self._moves += 1
        self._first += (1.0 - _BETA_1) * (slope - self._first)
        self._second += (1.0 - _BETA_2) * (slope**2 - self._second)
        first = self._first / (1.0 - _BETA_1**self._moves)
        second = self._second / (1.0 - _BETA_2**self._moves)
        rate = self._search.rate * self._search.rate_left**done
        amount = -rate * first / (math.sqrt(second) + _EPSILON)
        self.logarithm += amount
        self._motion.apply(parameters, amount)


@dataclass(frozen=True)
class _ViewThroughLens:
    """The lens as the `Correction` of a view, at a fraction of the search."""

    lens: _MovingLens
    view: int
    progress: float

    def camera(self, camera: RasterCamera) -> RasterCamera:
        return self.lens.camera(self.view, camera)

    def before_loss(self, frame: Frame) -> None:
        """Photographs are taken as they are."""

    def after_loss(self, frame: Frame) -> None:
        """Nothing was changed."""

    def after_backward(self, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        self.lens.move(self.view, self.progress, parameters, gradients, camera)


@dataclass(frozen=True)
class _SearchRun:
    """A search that has its scene."""

    search: LensSearch
    fit: Fit
    targets: Sequence[TrainingView]
    lens: _MovingLens
    poses: PoseRefinement
    order: ViewOrder

    @classmethod
    def of(
        cls,
        check: LensCheck,
        search: LensSearch,
        views: Sequence[View],
        points: NDArray[np.float32],
        colors: NDArray[np.uint8],
    ) -> _SearchRun | None:
        """Ready to run; None where the views cannot tell one lens from another."""
        plan, rng = check.plan, np.random.default_rng(check.seed)
        frame = SceneFrame.around(views, points)
        longest = max(side for view in views for side in (view.camera.width, view.camera.height))
        reduction = max(round(longest / search.side), 1)
        prepared = prepare_targets(check.rasterizer, views, frame, check.background, {reduction})
        targets = [TrainingView({1: view.at(reduction)}) for view in prepared]
        cameras = [view.at(1)[1] for view in targets]
        gaussians = plan.initial.make(views, points, colors, frame, rng, search.gaussians)
        if not len(gaussians):
            return None
        sampled = rng.permutation(len(gaussians))[:_SAMPLED]
        motion = hiding_motion(gaussians.means[sampled].astype(np.float64), cameras)
        if motion.seen < plan.hidden:
            return None
        fit = Fit(check.rasterizer, gaussians, check.background, TrainingPlan().ssim_weight)
        poses = PoseRefinement([camera.world_to_camera for camera in cameras])
        lens = _MovingLens(search, plan, motion, poses)
        return cls(search, fit, targets, lens, poses, ViewOrder(len(targets), rng))

    def result(self, logarithm: float, reporter: Reporter) -> _Found:
        """Fit the scene, whose cameras have a factor of this logarithm already."""
        plan, steps = TrainingPlan(), self.search.steps
        for step in range(steps):
            progress, view = step / steps, self.order.next()
            correction = _ViewThroughLens(self.lens, view, progress)
            self.fit.step(self.targets[view], 1, plan.rates_at(progress), correction=correction)
            if step % _PROGRESS_EVERY == 0:
                reporter.progress(STAGE, progress)
        motion = self.poses.image_motion([view.at(1)[1] for view in self.targets])
        return _Found(logarithm + self.lens.logarithm, self.lens.logarithm, motion)
