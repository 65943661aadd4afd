"""What is corrected of a run's views along with the scene: their exposure and their poses.

Both are decided on by measuring: `ViewCorrections.decide` switches on what the photographs call for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .exposure import ExposureCorrection, ExposurePlan, estimate_log_gains
from .poses import PosePlan, PoseRefinement, motion_to_match
from .raster import Frame, Gradients, ParameterSet, RasterCamera, Rasterizer
from .targets import Background, TrainingView

CORRECTED = "corrected"
"""What a decision in words begins with where something was corrected."""


class ViewCorrections:
    """The corrections of all views that a run fits.

    Args:
        rasterizer: of the run.
        views: that are fitted.
        background: of the run.
        exposure, poses: what may be corrected and how; None corrects nothing. Exposures of cut-outs are not corrected.
        steps: of the run, as long as planned.

    Attributes:
        exposure, poses: the corrections.
        poses_were_off: whether it was decided that the poses need correcting.
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
        # A gain would change the light behind cut-outs too, which no photograph shows.
        self._exposure_plan = None if any(background.color) else exposure
        self._pose_plan = poses
        self._visits = steps / len(views)
        self._exposure_undecided = self._exposure_plan is not None
        self._pose_tests = list(poses.decided) if poses is not None and poses.can_tell(steps, len(views)) else []
        self._cameras = [view.at(1)[1] for view in views]
        self.exposure = ExposureCorrection(rasterizer.device, len(views))
        self.poses = PoseRefinement([camera.world_to_camera for camera in self._cameras])
        self.poses_were_off = False
        self._progress = 0.0
        self._words: dict[str, str] = {}

    def decide(self, progress: float, parameters: ParameterSet) -> None:
        """Before the step at the fraction `progress` of the run: measure what has to be decided by now.

        `parameters` are the scene so far.
        """
        self._progress = progress
        if self._exposure_undecided and self._exposure_plan is not None and progress >= self._exposure_plan.decided:
            self._exposure_undecided = False
            self._decide_exposure(self._exposure_plan, parameters)
        while self._pose_plan is not None and self._pose_tests and progress >= self._pose_tests[0][0]:
            self._test_poses(self._pose_plan, self._pose_tests.pop(0)[1], parameters)

    def camera(self, view: int, camera: RasterCamera) -> RasterCamera:
        """The camera of `view`, at any resolution, where it is now."""
        return self.poses.camera(view, camera) if self.poses_were_off else camera

    def move(self, view: int, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        """Move the view's exposure and pose by their gradients, which are of `parameters` before these move."""
        if self._exposure_plan is not None:
            self.exposure.step(view, self._exposure_plan.rate_at(self._progress))
        if self._pose_plan is not None and self.poses_were_off:
            rate = self._pose_plan.rate_at(self._progress, self._visits)
            self.poses.step(view, parameters, gradients, camera, rate)

    def of(self, view: int) -> ViewCorrection:
        """What a step needs of one view's corrections."""
        return ViewCorrection(self, view)

    def seen(self, views: Sequence[int], reduction: int) -> list[TrainingView]:
        """Views as the scene sees them: photographs without their gains, at one level, and cameras where they are."""
        return [self._seen(view, reduction) for view in views]

    def in_words(self) -> dict[str, str]:
        """What was decided, for the report."""
        words = dict(self._words)
        if self.poses_were_off:
            words["poses"] = f"{CORRECTED}: they were off by about {self.pose_motion:.1f} pixels"
        return words

    @property
    def pose_motion(self) -> float:
        """How far the corrections of the poses have moved the images so far, in pixels."""
        return self.poses.image_motion(self._cameras)

    @property
    def moved_poses(self) -> NDArray[np.float64] | None:
        """(V, 4, 4) world-to-camera in frame units, or None where they are as given."""
        return self.poses.poses if self.poses_were_off else None

    def _test_poses(self, plan: PosePlan, threshold: float, parameters: ParameterSet) -> None:
        count = len(self._views)
        asked = np.linspace(0, count - 1, min(count, plan.probed_views)).round().astype(int).tolist()
        coarsest = max(self._views[0].levels)
        views = self.seen(asked, coarsest)
        motion = motion_to_match(self._rasterizer, views, coarsest, parameters, self._background, plan)
        self._words["poses"] = f"as given: photographs match the scene within {motion:.2f} pixels"
        if motion >= threshold:
            self.poses_were_off = True
            self._pose_tests.clear()

    def _decide_exposure(self, plan: ExposurePlan, parameters: ParameterSet) -> None:
        estimates = []
        for view in range(len(self._views)):
            image, camera = self._views[view].at(1)
            camera = self.camera(view, camera)
            rendered = self._rasterizer.render(parameters, camera, self._background.color).color.numpy()
            estimates.append(estimate_log_gains(rendered, image.numpy() * np.float32(1.0 / 255.0)))
        active = self.exposure.start(estimates, plan.threshold)
        spread = np.sqrt(np.mean((np.asarray(estimates) - np.mean(estimates, axis=0)) ** 2))
        decision = CORRECTED if active else "as photographed"
        self._words["exposure"] = f"{decision}: it differs by {spread:.1%} from view to view"

    def _seen(self, view: int, reduction: int) -> TrainingView:
        given = self._views[view]
        levels = {level: (image, self.camera(view, camera)) for level, (image, camera) in given.levels.items()}
        level = reduction if reduction in levels else 1
        if self.exposure.active:
            image, camera = levels[level]
            scene = np.clip(np.round(image.numpy() * np.exp(-self.exposure.log_gains[view])), 0, 255)
            levels[level] = wp.array(scene.astype(np.uint8), dtype=wp.uint8, device=self._rasterizer.device), camera
        return TrainingView(levels)


@dataclass(frozen=True)
class ViewCorrection:
    """The exposure and the pose of the view that a step is about, as a `Correction`."""

    corrections: ViewCorrections
    view: int

    def camera(self, camera: RasterCamera) -> RasterCamera:
        """The camera to render from."""
        return self.corrections.camera(self.view, camera)

    def before_loss(self, frame: Frame) -> None:
        """Give the rendered image the photograph's exposure."""
        self.corrections.exposure.apply(frame, self.view)

    def after_loss(self, frame: Frame) -> None:
        """Take the exposure out of the image and of its gradient again."""
        self.corrections.exposure.backward(frame, self.view)

    def after_backward(self, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera) -> None:
        """Move the corrections, before the optimiser moves the Gaussians."""
        self.corrections.move(self.view, parameters, gradients, camera)
