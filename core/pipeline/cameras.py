"""Looks whether given cameras fit their photographs, before a run, and finds others where they do not."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..capture.model import Capture
from ..splats.training import lens
from ..splats.training.given_cameras import GIVEN_POSES, GivenPoses, PoseCheck
from ..splats.training.lens import FOCAL_LENGTH, FocalLength, LensCheck, LensPlan
from ..splats.training.short_fit import ShortFit
from .stages import Stages


@dataclass(frozen=True)
class CheckedCameras:
    """What was found of a capture's cameras.

    Attributes:
        lens: their focal length.
        poses: as they were given.
    """

    lens: FocalLength = field(default_factory=FocalLength)
    poses: GivenPoses = field(default_factory=GivenPoses)

    @property
    def were_off(self) -> bool:
        """Whether anything is corrected."""
        return self.lens.was_off or self.poses.were_off

    @property
    def in_words(self) -> dict[str, str]:
        """The decisions, for the report; without those that did not come up."""
        said = {FOCAL_LENGTH: self.lens.words, GIVEN_POSES: self.poses.words}
        return {what: words for what, words in said.items() if words}

    def applied(self, stages: Stages) -> Stages:
        """The stages that follow, on the capture with what was found.

        Features are not as exact as a scene is, least of all in small photographs: poses that were adjusted to them are
        refined along with the scene if a trial gains by it.
        """
        stages = stages.on(self._corrected(stages.capture))
        training = stages.plans.training
        if not self.poses.were_off or self.poses.convention or training.poses is None:
            return stages
        return replace(
            stages, plans=replace(stages.plans, training=replace(training, poses=training.poses.always_tried()))
        )

    def _corrected(self, capture: Capture) -> Capture:
        moved = self.poses.replaced(capture) if self.poses.were_off else capture
        return moved.zoomed(self.lens.factor) if self.lens.was_off else moved


def check_cameras(stages: Stages) -> CheckedCameras:
    """Look at the cameras of a run that is long enough to be worth it.

    The focal length comes first: poses are adjusted to it. Where they were off, it could not be told from them, and is
    looked at again.
    """
    plan, settings = stages.plans.lens, stages.settings
    if plan is None or not settings.checks_lens or settings.iterations < plan.least_steps:
        return CheckedCameras()
    stages.reporter.status(lens.STAGE, lens.MESSAGE)
    found = CheckedCameras(lens=_focal_length(stages, plan))
    if stages.capture.estimate is None and len(stages.split.train) >= plan.fewest_views:
        poses = _poses(found.applied(stages), plan)
        found = CheckedCameras(found.lens, poses)
        if poses.were_off:
            again = _focal_length(found.applied(stages), plan)
            found = CheckedCameras(again.after(found.lens), poses)
    if found.lens.was_off:
        stages.reporter.warning(
            "lens-corrected",
            f"the cameras' focal length seems to be {found.lens.error}, and is corrected; a better calibration may "
            "give a sharper scene, and --no-refine-poses keeps it as it is",
        )
    if found.poses.were_off:
        stages.reporter.warning("cameras-corrected", _of_poses(found.poses))
    return found


def _of_poses(found: GivenPoses) -> str:
    if found.convention:
        return (
            f"the given camera poses fit what neighbouring photographs have in common {found.convention}, and are "
            "taken so; --no-refine-poses keeps them as they are"
        )
    return (
        f"only {found.fitting:.0%} of what neighbouring photographs have in common fits the given camera poses, so "
        "they were adjusted to it; poses from COLMAP may give a sharper scene, and --no-refine-poses keeps the given "
        "ones"
    )


def _focal_length(stages: Stages, plan: LensPlan) -> FocalLength:
    views = [stages.capture.views[index] for index in stages.split.train]
    check = LensCheck(stages.rasterizer, views, stages.background, plan, stages.settings.seed)
    return check.find(stages.capture.points, stages.capture.point_colors, stages.reporter)


def _poses(stages: Stages, plan: LensPlan) -> GivenPoses:
    size = (plan.second.steps, plan.second.gaussians, plan.second.side)
    fit = ShortFit(stages.rasterizer, stages.background, *size, plan.ssim_weight, plan.initial)
    check = PoseCheck(fit, plan.judging, plan.least_gain, stages.settings.seed)
    return check.find(stages.capture, stages.split.train, stages.reporter)
