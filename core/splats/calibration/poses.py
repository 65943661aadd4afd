"""Pose refinement: camera poses that are slightly off are corrected along with the scene, by the gradient of the loss.

A camera that moves is a scene that moves the other way: with the camera's pose W the loss depends on W x, so its
gradient with respect to a small motion of the camera is that of moving all Gaussians together: sums over the gradients
of means and quaternions that the rasteriser computes anyway. (The rotation of view-dependent colours is neglected, a
small term for SH degrees above 0.)

Good poses are left as given. The first rough scene, fitted with the given poses, shows whether they may be off
(`AlignedViews.motion_to_match`): if they contradict each other, the scene is a compromise, and single views match it
better from elsewhere. Whether that is so, and not the scene too rough, validation views tell in a trial. Letting poses
move and measuring how far they go tells less, because noise moves them too, in short runs farther than errors that
matter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...files.states import SavedState, State
from ..raster import Gradients, ParameterSet, RasterCamera, Rasterizer
from ..targets import Background, TrainingView
from .adam import AdamMoments, decayed, restore_moments, snapshot_moments
from .trial_plan import TrialPlan

# Of `PosePlan.align_steps`, in a trial: with 20 or 60 of them, what a correction gained differed by 0.13 dB at most
# (docs/trainer/rooms.md), and 60 on six views took three quarters of the trial's time.
_ROUGHLY = 1.0 / 3.0
_DEPTH = 1.0  # frame units from a camera to what it looks at, as around an object


@dataclass(frozen=True)
class PosePlan(TrialPlan):
    """When and how fast poses are refined.

    Learning rates are angles of view in radians.

    Attributes:
        checks: (fraction of the run, threshold in pixels) pairs: poses are refined from the first check on in which
            views have to move farther to match the scene (`AlignedViews.motion_to_match`). The rougher the scene, the
            farther good poses move: up to 0.71 pixels after a tenth of a run of 300 steps, 0.35 after two tenths. A
            quarter of a degree at 240 pixels is 0.8.
        least_steps: shortest run with checks; the scenes of shorter ones are too rough.
        probed_views: largest number of views in a check.
        probe_steps: steps per view in a check.
        probe_learning_rate: at the first of these steps, in pixels; `probe_lr_final_factor` of it at the last.
        learning_rate, max_learning_rate: at the start of the run. The larger is for short runs, which would otherwise
            end before a pose has moved far; noise grows with it.
        path: length of all steps of a view in a short run, at the initial learning rate, in radians.
        lr_final_factor: factor of the learning rate at the end of the run, reached exponentially.
        align_steps: per view, to align views that are not fitted with the scene (`AlignedViews`).
        follow_steps: per view, each time the scene has changed since.
        trial: share of the run's steps in each of the two branches of a trial, at least `fewest_trial_steps`. Before
            it, and after it where it pays, views that are `far` off are moved to where they match the scene, and the
            branch that corrects begins with faint Gaussians again: a sharp scene holds views where they are.
        far: motion in a check, in pixels, from which views are moved so.
        least_gain: dB that validation views, aligned with the scene of each branch, have to gain in it.
    """

    checks: tuple[tuple[float, float], ...] = ((0.1, 0.8), (0.2, 0.4))
    least_steps: int = 300
    probed_views: int = 8
    probe_steps: int = 10
    probe_learning_rate: float = 0.2
    probe_lr_final_factor: float = 0.1
    learning_rate: float = 1e-3
    max_learning_rate: float = 3e-3
    path: float = 0.03
    lr_final_factor: float = 0.05
    align_steps: int = 60
    follow_steps: int = 4
    trial: float = 0.08
    fewest_trial_steps: int = 150
    far: float = 0.8
    least_gain: float = 0.1

    def can_tell(self, steps: int, views: int) -> bool:
        """Whether a run of `steps` on `views` views can tell bad poses from good ones."""
        return views > 1 and steps >= self.least_steps

    def always_tried(self) -> PosePlan:
        """The same with a trial however little views have to move: for poses that are known to be inexact."""
        return replace(self, checks=tuple((when, 0.0) for when, _ in self.checks))

    def learning_rate_at(self, progress: float, visits: float) -> float:
        """The learning rate at the fraction `progress` of a run that visits each view `visits` times."""
        initial = min(max(self.path / visits, self.learning_rate), self.max_learning_rate)
        return decayed(initial, self.lr_final_factor, progress, self.checks[0][0])


def pose_gradient(
    parameters: ParameterSet, gradients: Gradients, world_to_camera: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(6,) gradient of the loss with respect to a small motion of the camera: translation, then rotation vector.

    The motion M, in camera axes, changes the pose to M @ world_to_camera.
    """
    means, quaternions = parameters.means, parameters.quaternions
    force = product_sums(None, gradients.means)[0]
    torque = _antisymmetric(product_sums(means, gradients.means))
    # A rotation by the small vector r turns the quaternion (w, v) into itself plus (-r v, w r + r x v) / 2.
    turning = product_sums(quaternions, gradients.quaternions)
    torque += 0.5 * (turning[0, 1:] - turning[1:, 0] + _antisymmetric(turning[1:, 1:]))
    rotation, translation = world_to_camera[:3, :3], world_to_camera[:3, 3]
    center = -rotation.T @ translation
    return np.concatenate([rotation @ force, rotation @ (torque - np.cross(center, force))])


class PoseRefinement:
    """The poses of all views, and their optimiser; their mean motion and scale are fixed, so the scene stays in place.

    Args:
        poses: (V, 4, 4) world-to-camera, rigid, in frame units.
        fixed_scene: the scene does not change, so the poses may move as a whole.
    """

    def __init__(self, poses: Sequence[NDArray[np.float64]], *, fixed_scene: bool = False) -> None:
        self._fixed_scene = fixed_scene
        self._given = np.stack(poses).astype(np.float64)
        self._poses = self._given.copy()
        self._extent = _extent(self._given)
        self._moments = [AdamMoments(shared=True) for _ in poses]
        self.active = len(poses) > 1 or fixed_scene

    @property
    def poses(self) -> NDArray[np.float64]:
        """(V, 4, 4) current world-to-camera poses."""
        return self._poses.copy()

    def camera(self, view: int, camera: RasterCamera) -> RasterCamera:
        """`camera` of `view`, at any resolution, in its current pose."""
        return replace(camera, world_to_camera=self._poses[view]) if self.active else camera

    def step(
        self, view: int, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera, learning_rate: float
    ) -> None:
        """Move the view's pose, given a backward pass of its image.

        An Adam step, but with one second moment for all six coordinates, which are scaled such that a unit of each
        moves the image about equally. So directions that hardly change the image, above all a rotation around the
        scene, hardly move; with a second moment each they would drift as fast as the others.
        """
        if not self.active:
            return
        coordinates = _coordinates(camera)
        gradient = coordinates.T @ pose_gradient(parameters, gradients, self._poses[view])
        if not np.isfinite(gradient).all():
            return
        mean, scale = self._moments[view].update(gradient)
        move = coordinates @ (-learning_rate * mean / scale)
        common = _in_world(move, self._poses[view]) / len(self._poses)
        self._poses[view] = _motion(move) @ self._poses[view]
        if not self._fixed_scene:
            self._poses = self._poses @ _motion(-common)
            self._poses[:, :3, 3] *= self._extent / _extent(self._poses)

    def go_to(self, poses: NDArray[np.float64]) -> None:
        """Take (V, 4, 4) poses instead of the current ones, but for what moves or scales all of them together."""
        twists = [_twist(now @ np.linalg.inv(given)) for now, given in zip(poses, self._given, strict=True)]
        worlds = [_in_world(twist, given) for twist, given in zip(twists, self._given, strict=True)]
        self._poses = poses @ _motion(-np.mean(worlds, axis=0))
        self._poses[:, :3, 3] *= self._extent / _extent(self._poses)

    def image_motion(self, cameras: Sequence[RasterCamera]) -> float:
        """RMS over the views of how far the corrections have moved the image centre, in pixels."""
        squares = []
        for now, given, camera in zip(self._poses, self._given, cameras, strict=True):
            seen = now @ np.linalg.inv(given) @ (0.0, 0.0, _DEPTH, 1.0)
            squares.append((camera.fx * seen[0] / seen[2]) ** 2 + (camera.fy * seen[1] / seen[2]) ** 2)
        return float(np.sqrt(np.mean(squares)))

    def snapshot(self) -> State:
        """What `restore` continues from."""
        return {"poses": self.poses, "moments": snapshot_moments(self._moments, 6)}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is of other views."""
        self._poses = saved.array("poses", np.float64, *self._given.shape)
        restore_moments(self._moments, 6, saved.part("moments"), np.copy)

    def put(self, view: int, pose: NDArray[np.float64]) -> None:
        """Replace the (4, 4) pose of a view."""
        self._poses[view] = pose


class AlignedViews:
    """Views that are not fitted, their poses aligned with a fixed scene by matching their photographs.

    Once the poses of the fitted views have been corrected, these are still as far off as those were, and a comparison
    would measure that.
    """

    def __init__(
        self, rasterizer: Rasterizer, views: Sequence[TrainingView], background: Background, plan: PosePlan
    ) -> None:
        self._rasterizer = rasterizer
        self._given = list(views)
        self._background = background
        self._plan = plan
        self._cameras = [view.at(1)[1] for view in views]
        self._refinement = PoseRefinement([camera.world_to_camera for camera in self._cameras], fixed_scene=True)
        self._aligned = False

    @property
    def poses(self) -> NDArray[np.float64]:
        """(V, 4, 4) world-to-camera in frame units."""
        return self._refinement.poses

    @property
    def views(self) -> list[TrainingView]:
        """The views in these poses."""
        return [view.moved(pose) for view, pose in zip(self._given, self.poses, strict=True)]

    def leave_out(self, regions: Mapping[int, NDArray[np.bool_]]) -> None:
        """Look no longer at (H, W) regions of views, by their indices."""
        self._given = [view.without(regions.get(index)) for index, view in enumerate(self._given)]

    def snapshot(self) -> State:
        """What `restore` continues from."""
        return {"aligned": self._aligned, "refinement": self._refinement.snapshot()}

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is of other views."""
        self._aligned = saved.value("aligned", bool)
        self._refinement.restore(saved.part("refinement"))

    def align(self, parameters: ParameterSet) -> None:
        """Align the poses with the current scene: from the given poses at first, then from the latest ones."""
        plan = self._plan
        following = [plan.learning_rate * plan.lr_final_factor] * plan.follow_steps
        rates = following if self._aligned else self._first_rates(plan.align_steps)
        self._aligned = True
        for view in range(len(self._given)):
            self._match(view, 1, parameters, rates)

    def align_roughly(self, parameters: ParameterSet, reduction: int) -> None:
        """Align the given poses with a scene as well as it takes to compare it with another.

        Args:
            reduction: factor by which the views are reduced for it.
        """
        rates = self._first_rates(math.ceil(_ROUGHLY * self._plan.align_steps))
        for view in range(len(self._given)):
            self._match(view, reduction, parameters, rates)

    def motion_to_match(self, parameters: ParameterSet, reduction: int) -> float:
        """How far the views have to move to match the scene: RMS over them, in pixels of the full images.

        An underestimate beyond a pixel or two, which the few steps do not reach.

        Args:
            reduction: factor by which the views are reduced for it.
        """
        plan = self._plan
        factors = plan.probe_lr_final_factor ** (np.arange(plan.probe_steps) / plan.probe_steps)
        for view, camera in enumerate(self._cameras):
            self._match(view, reduction, parameters, (plan.probe_learning_rate / camera.fx * factors).tolist())
        return self._refinement.image_motion(self._cameras)

    def _first_rates(self, steps: int) -> list[float]:
        done = np.arange(steps) / steps
        return (self._plan.max_learning_rate * self._plan.lr_final_factor**done).tolist()

    def _match(self, view: int, reduction: int, parameters: ParameterSet, learning_rates: Sequence[float]) -> None:
        image, camera = self._given[view].at(reduction)
        mask = self._given[view].mask_at(reduction)
        for learning_rate in learning_rates:
            moved = self._refinement.camera(view, camera)
            frame = self._rasterizer.render(parameters, moved, self._background.color)
            self._rasterizer.photometric_loss(frame, image, mask=mask)
            self._refinement.step(view, parameters, self._rasterizer.backward(frame), moved, learning_rate)


def _extent(poses: NDArray[np.float64]) -> float:
    """RMS distance of the cameras from their mean."""
    centers = np.einsum("vji,vj->vi", poses[:, :3, :3], -poses[:, :3, 3])
    return float(np.sqrt(centers.var(axis=0).sum())) or 1.0


def _coordinates(camera: RasterCamera) -> NDArray[np.float64]:
    """(6, 6) columns: motions (translation, rotation vector) in camera axes that move the image about equally.

    Rotations about x, y and z through the camera's centre; translation along z; and orbits about x and y through the
    scene, which leave what is at its depth in place and show in the parallax alone.
    """
    # Motion at the edge of the image, relative to that of the whole image in a rotation about x or y.
    lever = np.hypot(camera.width / camera.fx, camera.height / camera.fy) / np.sqrt(12.0)
    columns = np.zeros((6, 6))
    columns[3, 0] = columns[4, 1] = 1.0
    columns[5, 2] = 1.0 / lever
    columns[2, 3] = _DEPTH / lever
    columns[3, 4], columns[1, 4] = 1.0, _DEPTH
    columns[4, 5], columns[0, 5] = 1.0, -_DEPTH
    return columns


def product_sums(first: wp.array | None, second: wp.array) -> NDArray[np.float64]:
    """(A, B) product firstᵀ @ second of (N, A) and (N, B) arrays; a column of ones for None."""
    right = wp.to_torch(second, requires_grad=False)
    if first is None:
        return right.sum(dim=0, keepdim=True).cpu().numpy().astype(np.float64)
    left = wp.to_torch(first, requires_grad=False)
    return (left.T @ right).cpu().numpy().astype(np.float64)


def _antisymmetric(products: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sum of cross products a x b from the (3, 3) sums of products of a's and b's components."""
    return np.array([products[1, 2] - products[2, 1], products[2, 0] - products[0, 2], products[0, 1] - products[1, 0]])


def _motion(twist: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) rigid: rotation by the vector `twist[3:]`, then translation by `twist[:3]`."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_rotvec(twist[3:]).as_matrix()
    result[:3, 3] = twist[:3]
    return result


def _twist(motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """(6,) of which `_motion` makes a (4, 4) rigid motion."""
    return np.concatenate([motion[:3, 3], Rotation.from_matrix(motion[:3, :3]).as_rotvec()])


def _in_world(twist: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The small motion before `pose` that equals `twist` after it, to first order."""
    rotation, translation = pose[:3, :3], pose[:3, 3]
    return np.concatenate([rotation.T @ (twist[:3] + np.cross(twist[3:], translation)), rotation.T @ twist[3:]])
