"""Corrections of a run's views along with the scene: exposures and poses.

Either is proposed where a measurement suggests that the photographs call for it (`ViewCorrections.decide`), and stays
on if validation views gain by it in a trial (`ViewCorrections.settle`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...files.states import SavedState, State
from ..raster import Frame, Gradients, ParameterSet, RasterCamera, Rasterizer
from ..targets import Background, TrainingView
from .exposure import ExposureCorrection, ExposurePlan, estimate_log_gains
from .poses import AlignedViews, PosePlan, PoseRefinement

CORRECTED = "corrected"
"""First word of a report's decision on something that was corrected."""


class Proposal(Enum):
    """What seems to call for a correction."""

    EXPOSURE = "exposure"
    POSES = "poses"


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


class ViewCorrections:
    """The corrections of all views that a run fits.

    Args:
        rasterizer: of the run.
        views: that are fitted.
        background: of the run.
        exposure, poses: how to correct; None to leave as given. Exposures of cut-outs are never corrected.
        steps: planned length of the run.

    Attributes:
        exposure, poses: the corrections.
        poses_were_off: whether the poses are corrected, because a check found that they need it.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        views: Sequence[TrainingView],
        background: Background,
        exposure: ExposurePlan | None,
        poses: PosePlan | None,
        steps: int,
    ) -> None:
        self._rasterizer = rasterizer
        self._views = views
        self._background = background
        # A gain would also change the background of cut-outs, which no photograph shows.
        self._exposure_plan = None if any(background.color) else exposure
        self._pose_plan = poses
        self._steps = steps
        self._visits = steps / len(views)
        self._exposure_undecided = self._exposure_plan is not None
        self._pose_checks = list(poses.checks) if poses is not None and poses.can_tell(steps, len(views)) else []
        self._cameras = [view.at(1)[1] for view in views]
        self.exposure = ExposureCorrection(rasterizer.device, len(views))
        self.poses = PoseRefinement([camera.world_to_camera for camera in self._cameras])
        self.poses_were_off = False
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

    def decide(self, progress: float, parameters: ParameterSet) -> list[Proposal]:
        """Make the checks due at the fraction `progress` of the run, on the current scene; called before a step.

        Returns:
            What is corrected from now on because it seems to be off. That a rough scene differs from its photographs
            may be the scene's fault: only a trial tells (`switch`, `settle`).
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
        return proposed

    def switch(self, proposal: Proposal, corrected: bool) -> None:
        """Correct, from the start, or leave what was proposed: a branch of a trial."""
        if proposal is Proposal.EXPOSURE:
            self.exposure.active = corrected
        else:
            self.poses = PoseRefinement([camera.world_to_camera for camera in self._cameras])
            self.poses_were_off = corrected

    def trial_steps(self, proposal: Proposal) -> int:
        """Steps of each branch of a trial."""
        plan = self._exposure_plan if proposal is Proposal.EXPOSURE else self._pose_plan
        assert plan is not None, "only a plan proposes a correction"
        return plan.trial_steps(self._steps)

    def settle(self, proposal: Proposal, gain: float) -> bool:
        """Correct only if the validation views gained enough (dB) by it in a trial; returns whether.

        Called at the end of the branch that corrects. Poses that are left may be proposed by the next check again.
        """
        plan = self._exposure_plan if proposal is Proposal.EXPOSURE else self._pose_plan
        assert plan is not None, "only a plan proposes a correction"
        worthwhile = gain >= plan.least_gain
        if not worthwhile:
            self.switch(proposal, False)
        trial = f"correcting that gained {gain:.2f} dB in a trial"
        if proposal is Proposal.EXPOSURE:
            seemed = self._words["exposure"].partition(": ")[2]
            self._words["exposure"] = f"{CORRECTED if worthwhile else 'as photographed'}: {seemed}, and {trial}"
        else:
            self._words["poses"] += f", and {trial}"
        return worthwhile

    def camera(self, view: int, camera: RasterCamera) -> RasterCamera:
        """The camera of `view`, at any resolution, in its current pose."""
        return self.poses.camera(view, camera) if self.poses_were_off else camera

    def move(self, view: int, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        """Update the view's exposure and pose by their gradients, before the optimiser moves `parameters`."""
        if self._exposure_plan is not None:
            self.exposure.step(view, self._exposure_plan.learning_rate_at(self._progress))
        if self._pose_plan is not None and self.poses_were_off:
            learning_rate = self._pose_plan.learning_rate_at(self._progress, self._visits)
            self.poses.step(view, parameters, gradients, camera, learning_rate)

    def of(self, view: int) -> ViewCorrection:
        """The corrections of one view, for a training step."""
        return ViewCorrection(self, view)

    def seen(self, views: Sequence[int], reduction: int) -> list[TrainingView]:
        """Views as the scene sees them: photographs without their gains, at one level, and cameras in current poses."""
        return [self._seen(view, reduction) for view in views]

    def in_words(self) -> dict[str, str]:
        """The decisions, for the report."""
        words = dict(self._words)
        if self.poses_were_off:
            trial = "".join(words.get("poses", "").partition(", and ")[1:])
            words["poses"] = f"{CORRECTED}: they were off by about {self.pose_motion:.1f} pixels{trial}"
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
        count = len(self._views)
        probed = np.linspace(0, count - 1, min(count, plan.probed_views)).round().astype(int).tolist()
        coarsest = max(self._views[0].levels)
        views = self.seen(probed, coarsest)
        aligned = AlignedViews(self._rasterizer, views, self._background, plan)
        motion = aligned.motion_to_match(parameters, coarsest)
        self._words["poses"] = f"as given: photographs match the scene within {motion:.2f} pixels"
        return motion >= threshold

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
        return TrainingView(levels, given.masks)


@dataclass(frozen=True)
class ViewCorrection(Correction):
    """The exposure and the pose of one view."""

    corrections: ViewCorrections
    view: int

    def camera(self, camera: RasterCamera) -> RasterCamera:
        return self.corrections.camera(self.view, camera)

    def before_loss(self, frame: Frame) -> None:
        self.corrections.exposure.apply(frame, self.view)

    def after_loss(self, frame: Frame) -> None:
        self.corrections.exposure.backward(frame, self.view)

    def after_backward(self, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        self.corrections.move(self.view, parameters, gradients, camera)
