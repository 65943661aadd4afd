"""Corrections of a run's views along with the scene: exposures, poses and motion blur.

Each is proposed where a measurement suggests that the photographs call for it (`ViewCorrections.decide`), and stays
on if validation views gain by it in a trial (`ViewCorrections.settle`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...files.states import SavedState, State
from ...intake.sampling import evenly_spread
from ..raster import Frame, Gradients, ParameterSet, RasterCamera, Rasterizer
from ..targets import Background, TrainingView
from .exposure import ExposureCorrection, ExposurePlan, estimate_log_gains
from .motion_blur import MotionBlur, MotionBlurPlan, best_line, longest_line, typical_length
from .poses import AlignedViews, PosePlan, PoseRefinement

CORRECTED = "corrected"
"""First word of a report's decision on something that was corrected."""


class Proposal(Enum):
    """What seems to call for a correction."""

    EXPOSURE = "exposure"
    POSES = "poses"
    BLUR = "motion_blur"


class Correction:
    """Corrections of one view in a training step: hooks, called in this order, that do nothing unless overridden."""

    def camera(self, camera: RasterCamera) -> RasterCamera:
        """The camera to render from."""
        return camera

    def before_loss(self, frame: Frame) -> None:
        """Make the rendered image comparable to the photograph."""

    def after_loss(self, frame: Frame) -> None:
        """Undo `before_loss`, in the image and in its gradient."""

    def after_backward(self, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        """Update the corrections, before the optimiser moves the Gaussians."""


class KnownBlur:
    """Motion blur that is known already, by view.

    Args:
        device: of the frames.
        smears: (2,) lines in pixels of the frames; None for those of sharp photographs.
    """

    def __init__(self, device: wp.Device, smears: Sequence[NDArray[np.float64] | None]) -> None:
        self._blur = MotionBlur(device, len(smears))
        if any(line is not None for line in smears):
            self._blur.start([np.zeros(2) if line is None else line for line in smears])

    def of(self, view: int) -> Correction:
        """For a step on a view at full resolution."""
        return _KnownBlurOfView(self._blur, view)


@dataclass(frozen=True)
class _KnownBlurOfView(Correction):
    blur: MotionBlur
    view: int

    def before_loss(self, frame: Frame) -> None:
        self.blur.apply(frame, self.view, 1.0)

    def after_loss(self, frame: Frame) -> None:
        self.blur.backward(frame, self.view, 1.0)


class ViewCorrections:
    """The corrections of all views that a run fits.

    Args:
        rasterizer: of the run.
        views: that are fitted.
        background: of the run.
        exposure, poses, blur: how to correct; None to leave as given. Exposures of cut-outs are never corrected.
        steps: planned length of the run.

    Attributes:
        exposure, poses, blur: the corrections.
        poses_were_off: whether the poses are corrected, because a check found that they need it.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        views: Sequence[TrainingView],
        background: Background,
        exposure: ExposurePlan | None,
        poses: PosePlan | None,
        blur: MotionBlurPlan | None,
        steps: int,
    ) -> None:
        self._rasterizer = rasterizer
        self._views = views
        self._background = background
        # A gain would also change the background of cut-outs, which no photograph shows.
        self._exposure_plan = None if any(background.color) else exposure
        self._pose_plan = poses
        self._blur_plan = blur
        self._steps = steps
        self._visits = steps / len(views)
        self._exposure_undecided = self._exposure_plan is not None
        self._pose_checks = list(poses.checks) if poses is not None and poses.can_tell(steps, len(views)) else []
        self._blur_undecided = blur is not None and steps >= blur.least_steps and len(views) > 1
        self._cameras = [view.at(1)[1] for view in views]
        self.exposure = ExposureCorrection(rasterizer.device, len(views))
        self.poses = PoseRefinement([camera.world_to_camera for camera in self._cameras])
        self.poses_were_off = False
        self._far_off = False  # in the last check, and of no use after its trial
        self.blur = MotionBlur(rasterizer.device, len(views))
        if any(view.smear is not None for view in views):
            self.blur.start([np.zeros(2) if view.smear is None else view.smear for view in views])
            self._blur_undecided = False
        self._lines: list[NDArray[np.float64]] = []
        self._progress = 0.0
        self._words: dict[str, str] = {}

    def snapshot(self) -> State:
        """What `restore` continues from, between two steps."""
        return {
            "exposure_undecided": self._exposure_undecided,
            "pose_checks": len(self._pose_checks),
            "poses_were_off": self.poses_were_off,
            "progress": self._progress,
            "words": self._words,
            "exposure": self.exposure.snapshot(),
            "poses": self.poses.snapshot(),
            "blur_undecided": self._blur_undecided,
            "blur": self.blur.snapshot(),
        }

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is of other views."""
        self._exposure_undecided = saved.value("exposure_undecided", bool)
        made = len(self._pose_checks) - saved.number("pose_checks", 0, len(self._pose_checks))
        self._pose_checks = self._pose_checks[made:]
        self.poses_were_off = saved.value("poses_were_off", bool)
        self._progress = saved.value("progress", float)
        self._words = {name: str(words) for name, words in saved.value("words", dict).items()}
        self.exposure.restore(saved.part("exposure"))
        self.poses.restore(saved.part("poses"))
        self._blur_undecided = saved.value("blur_undecided", bool)
        self.blur.restore(saved.part("blur"))

    def decide(
        self, progress: float, parameters: ParameterSet, report: Callable[[str], None] = lambda _: None
    ) -> list[Proposal]:
        """Make the checks due at the fraction `progress` of the run, on the current scene; called before a step.

        Args:
            report: told how far a measurement of all views is.

        Returns:
            What seems to be off: exposures and poses are corrected from now on, motion blur once `switch` says so. That
            a rough scene differs from its photographs may be the scene's fault: only a trial tells (`settle`).
        """
        self._progress = progress
        proposed = []
        if self._exposure_undecided and self._exposure_plan is not None and progress >= self._exposure_plan.decided_at:
            self._exposure_undecided = False
            if self._decide_exposure(self._exposure_plan, parameters):
                proposed.append(Proposal.EXPOSURE)
        while self._pose_plan is not None and self._pose_checks and progress >= self._pose_checks[0][0]:
            threshold = self._pose_checks.pop(0)[1]
            if not self.poses_were_off and self._poses_seem_off(self._pose_plan, threshold, parameters):
                self.poses_were_off = True
                proposed.append(Proposal.POSES)
        if self._blur_undecided and self._blur_plan is not None and progress >= self._blur_plan.decided_at:
            self._blur_undecided = False
            # Where cameras were off, a photograph that is still out of place looks smeared.
            if not self.poses_were_off and self._seems_blurred(self._blur_plan, parameters, report):
                proposed.append(Proposal.BLUR)
        return proposed

    def switch(self, proposal: Proposal, corrected: bool) -> None:
        """Correct, from the start, or leave what was proposed: a branch of a trial."""
        if proposal is Proposal.EXPOSURE:
            self.exposure.active = corrected
        elif proposal is Proposal.BLUR:
            self.blur.start(self._lines)
            self.blur.active = corrected
        else:
            self.poses = PoseRefinement([camera.world_to_camera for camera in self._cameras])
            self.poses_were_off = corrected

    def match_poses(self, parameters: ParameterSet) -> bool:
        """Move the poses that are corrected to where each view matches the current scene, if they were far off.

        Returns:
            Whether they were.
        """
        if self._pose_plan is not None and self._far_off:
            self.poses.go_to(self._matched(self._pose_plan, range(len(self._views)), parameters)[0])
        return self._far_off

    def trial_steps(self, proposal: Proposal) -> int:
        """Steps of each branch of a trial."""
        return self._plan_of(proposal).trial_steps(self._steps)

    def settle(self, proposal: Proposal, gain: float) -> bool:
        """Correct only if the validation views gained enough (dB) by it in a trial; returns whether.

        Called at the end of the branch that corrects. Poses that are left may be proposed by the next check again.
        """
        worthwhile = gain >= self._plan_of(proposal).least_gain
        if not worthwhile:
            self.switch(proposal, False)
        trial = f"correcting that gained {gain:.2f} dB in a trial"
        if proposal is Proposal.EXPOSURE:
            seemed = self._words["exposure"].partition(": ")[2]
            self._words["exposure"] = f"{CORRECTED if worthwhile else 'as photographed'}: {seemed}, and {trial}"
        else:
            self._words[proposal.value] += f", and {trial}"
        return worthwhile

    @property
    def smears(self) -> NDArray[np.float64] | None:
        """(V, 2) lines of the views in pixels, or None if photographs are taken to be sharp."""
        return self.blur.lines.copy() if self.blur.active else None

    def _plan_of(self, proposal: Proposal) -> ExposurePlan | PosePlan | MotionBlurPlan:
        plans = {
            Proposal.EXPOSURE: self._exposure_plan,
            Proposal.POSES: self._pose_plan,
            Proposal.BLUR: self._blur_plan,
        }
        plan = plans[proposal]
        assert plan is not None, "only a plan proposes a correction"
        return plan

    def admit(self, first: int, poses: NDArray[np.float64] | None, parameters: ParameterSet) -> None:
        """Fit the views from `first` on from now on, which validated so far.

        Args:
            poses: (V, 4, 4) of them, aligned with the scene; None if poses are as given.
            parameters: of the scene.
        """
        for view, pose in enumerate(() if poses is None else poses, first):
            self.poses.put(view, pose)
        for view in range(first, len(self._views) if self.blur.active else 0):
            self.blur.lines[view] = self.best_line(view, parameters)

    def camera(self, view: int, camera: RasterCamera) -> RasterCamera:
        """The camera of `view`, at any resolution, in its current pose."""
        return self.poses.camera(view, camera) if self.poses_were_off else camera

    def move(self, view: int, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        """Update the view's exposure, line and pose by their gradients, before the optimiser moves `parameters`."""
        if self._exposure_plan is not None:
            self.exposure.step(view, self._exposure_plan.learning_rate_at(self._progress))
        if self._blur_plan is not None:
            longest = longest_line(self._cameras[view].width, self._cameras[view].height)
            self.blur.step(view, self._blur_plan.learning_rate_at(self._progress), longest)
        if self._pose_plan is not None and self.poses_were_off:
            learning_rate = self._pose_plan.learning_rate_at(self._progress, self._visits)
            self.poses.step(view, parameters, gradients, camera, learning_rate)

    def of(self, view: int) -> ViewCorrection:
        """The corrections of one view, for a training step."""
        return ViewCorrection(self, view)

    def reduction(self, view: int, frame: Frame) -> float:
        """The factor by which a frame of `view` is reduced."""
        return self._cameras[view].fx / frame.camera.fx

    def seen(self, views: Sequence[int], reduction: int) -> list[TrainingView]:
        """Views as the scene sees them: photographs without their gains, at one level, and cameras in current poses."""
        return [self._seen(view, reduction) for view in views]

    def in_words(self) -> dict[str, str]:
        """The decisions, for the report."""
        words = dict(self._words)
        if self.poses_were_off:
            trial = "".join(words.get("poses", "").partition(", and ")[1:])
            words["poses"] = f"{CORRECTED}: they were off by about {self.pose_motion:.1f} pixels{trial}"
        if self.blur.active:
            trial = "".join(words.get("motion_blur", "").partition(", and ")[1:])
            words["motion_blur"] = (
                f"{CORRECTED}: a quarter of the photographs are smeared by {self.blur.length:.1f} pixels or more{trial}"
            )
        return words

    @property
    def pose_motion(self) -> float:
        """How far the pose corrections have moved the images so far, in pixels (RMS)."""
        return self.poses.image_motion(self._cameras)

    @property
    def moved_poses(self) -> NDArray[np.float64] | None:
        """(V, 4, 4) world-to-camera in frame units, or None if they are as given."""
        return self.poses.poses if self.poses_were_off else None

    def _poses_seem_off(self, plan: PosePlan, threshold: float, parameters: ParameterSet) -> bool:
        _, motion = self._matched(plan, evenly_spread(range(len(self._views)), plan.probed_views), parameters)
        self._far_off = motion >= plan.far
        self._words["poses"] = f"as given: photographs match the scene within {motion:.2f} pixels"
        return motion >= threshold

    def _matched(
        self, plan: PosePlan, chosen: Sequence[int], parameters: ParameterSet
    ) -> tuple[NDArray[np.float64], float]:
        """(V, 4, 4) poses from where the chosen views match a scene, and how far in pixels they are from theirs."""
        coarsest = max(self._views[0].levels)
        aligned = AlignedViews(self._rasterizer, self.seen(chosen, coarsest), self._background, plan)
        motion = aligned.motion_to_match(parameters, coarsest)
        return aligned.poses, motion

    def _seems_blurred(self, plan: MotionBlurPlan, parameters: ParameterSet, report: Callable[[str], None]) -> bool:
        views = range(len(self._views))
        found = {view: self.best_line(view, parameters) for view in evenly_spread(views, plan.probed_views)}
        length = typical_length(list(found.values()))
        if length < plan.threshold:
            return False
        self._words["motion_blur"] = f"as photographed: a quarter seem to be smeared by {length:.1f} pixels"
        self._lines = []
        for view in views:
            report(f"measuring motion blur, view {view + 1:,} of {len(views):,}")
            self._lines.append(found[view] if view in found else self.best_line(view, parameters))
        return True

    def best_line(self, view: int, parameters: ParameterSet) -> NDArray[np.float64]:
        """The line along which the scene is most like the photograph of `view`, in pixels of the full image."""
        seen = self._seen(view, 1)
        image, camera = seen.at(1)
        rendered = self._rasterizer.render(parameters, camera, self._background.color).color.numpy()
        photograph = image.numpy() * np.float32(1.0 / 255.0)
        return best_line(rendered, photograph, seen.looked_at(), device=self._rasterizer.device)

    def _decide_exposure(self, plan: ExposurePlan, parameters: ParameterSet) -> bool:
        estimates = []
        for view in range(len(self._views)):
            image, camera = self._views[view].at(1)
            camera = self.camera(view, camera)
            rendered = self._rasterizer.render(parameters, camera, self._background.color).color.numpy()
            photograph = image.numpy() * np.float32(1.0 / 255.0)
            estimates.append(estimate_log_gains(rendered, photograph, self._views[view].looked_at()))
        active = self.exposure.start(estimates, plan.threshold)
        spread = np.sqrt(np.mean((np.asarray(estimates) - np.mean(estimates, axis=0)) ** 2))
        decision = CORRECTED if active else "as photographed"
        self._words["exposure"] = f"{decision}: it differs by {spread:.1%} from view to view"
        return active

    def _seen(self, view: int, reduction: int) -> TrainingView:
        given = self._views[view]
        levels = {level: (image, self.camera(view, camera)) for level, (image, camera) in given.levels.items()}
        level = reduction if reduction in levels else 1
        if self.exposure.active:
            image, camera = levels[level]
            scene = np.clip(np.round(image.numpy() * np.exp(-self.exposure.log_gains[view])), 0, 255)
            levels[level] = wp.array(scene.astype(np.uint8), dtype=wp.uint8, device=self._rasterizer.device), camera
        return TrainingView(levels, given.masks, self.blur.line(view))


@dataclass(frozen=True)
class ViewCorrection(Correction):
    """The exposure, the motion blur and the pose of one view."""

    corrections: ViewCorrections
    view: int

    def camera(self, camera: RasterCamera) -> RasterCamera:
        return self.corrections.camera(self.view, camera)

    def before_loss(self, frame: Frame) -> None:
        self.corrections.blur.apply(frame, self.view, self.corrections.reduction(self.view, frame))
        self.corrections.exposure.apply(frame, self.view)

    def after_loss(self, frame: Frame) -> None:
        self.corrections.exposure.backward(frame, self.view)
        self.corrections.blur.backward(frame, self.view, self.corrections.reduction(self.view, frame))

    def after_backward(self, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        self.corrections.move(self.view, parameters, gradients, camera)
