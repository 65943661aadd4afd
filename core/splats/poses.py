"""Camera poses that are a little off, corrected along with the scene by the gradient of the loss.

A camera that moves is a scene that moves the other way: with the camera's pose W the loss depends on W x, so its
gradient with respect to a small motion of the camera is that of moving all Gaussians together: sums over what the
rasteriser returns for means and quaternions anyway. (How the colours of turned Gaussians depend on the direction stays
as it is, so with colours of degree above 0 a small term is left out.)

Poses that are good stay as they were. Whether they are is asked of the first rough scene, fitted with the poses as
given (`motion_to_match`): where they contradict each other it is a compromise, and single views match it better from
somewhere else. Letting poses move and looking how far they come tells less, because they move by noise alone too, in
short runs farther than poses that matter are off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .raster import Gradients, ParameterSet, RasterCamera, Rasterizer
from .targets import Background, TrainingView

_BETA_1, _BETA_2 = 0.9, 0.99  # of the moving averages; a view is visited some hundred times
_EPSILON = 1e-30
_DEPTH = 1.0  # frame units from a camera to what it looks at: the unit is the cameras' distance from their middle


@dataclass(frozen=True)
class PosePlan:
    """When and how fast poses move.

    Attributes:
        decided: (fraction of the run, pixels) pairs: poses are off, and move from then on, where views match the scene
            better from so far away (`motion_to_match`). The rougher the scene, the farther good ones seem to be: up to
            0.71 pixels after a tenth of a run of 300 steps, 0.35 after two. A quarter of a degree at 240 pixels: 0.8.
        least_steps: of a run in which this is asked at all: shorter ones are rougher than that.
        probed_views: at most so many are asked that.
        probe_steps: of each of them.
        probe_rate: step size of these at the start, in pixels; `probe_left` of it is left at the end.
        rate, largest_rate: step size at the start, as an angle of view in radians. The larger is for short runs, which
            otherwise were over before a pose has come far; noise grows with it.
        path: what the steps at the start's size would add up to in a run that is short, in radians.
        rate_left: what is left of the step size at the end, reached exponentially.
        align_steps: of a view that is aligned with a scene which is not fitted to it (`AlignedViews`).
        follow_steps: of such a view each time that the scene has changed since.
    """

    decided: tuple[tuple[float, float], ...] = ((0.1, 0.8), (0.2, 0.4))
    least_steps: int = 300
    probed_views: int = 8
    probe_steps: int = 10
    probe_rate: float = 0.2
    probe_left: float = 0.1
    rate: float = 1e-3
    largest_rate: float = 3e-3
    path: float = 0.03
    rate_left: float = 0.05
    align_steps: int = 60
    follow_steps: int = 4

    def can_tell(self, steps: int, views: int) -> bool:
        """Whether a run of so many steps on so many views can tell poses that are off from good ones."""
        return views > 1 and steps >= self.least_steps

    def rate_at(self, progress: float, visits: float) -> float:
        """The step size when the fraction `progress` of the run is done, which visits each view `visits` times."""
        start = min(max(self.path / visits, self.rate), self.largest_rate)
        started = self.decided[0][0]
        return start * self.rate_left ** min(max((progress - started) / (1.0 - started), 0.0), 1.0)


def pose_gradient(
    parameters: ParameterSet, gradients: Gradients, world_to_camera: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(6,) gradient of the loss with respect to a small motion of the camera: its translation and its rotation vector.

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
    """The poses of all views, and their optimiser; as a whole they neither move nor grow, so the scene stays in place.

    Args:
        poses: (V, 4, 4) world-to-camera, rigid, in frame units.
        fixed_scene: the scene stays in place by itself, so the poses may move as a whole.
    """

    def __init__(self, poses: Sequence[NDArray[np.float64]], *, fixed_scene: bool = False) -> None:
        self._fixed_scene = fixed_scene
        self._given = np.stack(poses).astype(np.float64)
        self._poses = self._given.copy()
        self._extent = _extent(self._given)
        self._first, self._second = np.zeros((len(poses), 6)), np.zeros(len(poses))
        self._visits = np.zeros(len(poses), np.int64)
        self.active = len(poses) > 1 or fixed_scene

    @property
    def poses(self) -> NDArray[np.float64]:
        """(V, 4, 4) as they are now."""
        return self._poses.copy()

    def camera(self, view: int, camera: RasterCamera) -> RasterCamera:
        """`camera` of `view`, at any resolution, where it is now."""
        return replace(camera, world_to_camera=self._poses[view]) if self.active else camera

    def step(
        self, view: int, parameters: ParameterSet, gradients: Gradients, camera: RasterCamera, rate: float
    ) -> None:
        """Move the view's pose with step size `rate` (radians), given a backward pass of its image.

        As Adam does, but with one second moment for all six coordinates, which are such that a unit of each moves the
        image by about as much. So directions that hardly change the image, a turn around the scene above all, hardly
        move; with a second moment each they would wander as fast as those that do.
        """
        if not self.active:
            return
        coordinates = _coordinates(camera)
        slope = coordinates.T @ pose_gradient(parameters, gradients, self._poses[view])
        if not np.isfinite(slope).all():
            return
        self._visits[view] += 1
        self._first[view] += (1.0 - _BETA_1) * (slope - self._first[view])
        self._second[view] += (1.0 - _BETA_2) * ((slope**2).mean() - self._second[view])
        first = self._first[view] / (1.0 - _BETA_1 ** self._visits[view])
        second = self._second[view] / (1.0 - _BETA_2 ** self._visits[view])
        move = coordinates @ (-rate * first / (np.sqrt(second) + _EPSILON))
        common = _in_world(move, self._poses[view]) / len(self._poses)
        self._poses[view] = _motion(move) @ self._poses[view]
        if not self._fixed_scene:
            self._poses = self._poses @ _motion(-common)
            self._poses[:, :3, 3] *= self._extent / _extent(self._poses)

    def image_motion(self, cameras: Sequence[RasterCamera]) -> float:
        """RMS over the views of how far the corrections have moved the middle of what is seen, in pixels."""
        squares = []
        for now, given, camera in zip(self._poses, self._given, cameras, strict=True):
            seen = now @ np.linalg.inv(given) @ (0.0, 0.0, _DEPTH, 1.0)
            squares.append((camera.fx * seen[0] / seen[2]) ** 2 + (camera.fy * seen[1] / seen[2]) ** 2)
        return float(np.sqrt(np.mean(squares)))

    def put(self, view: int, pose: NDArray[np.float64]) -> None:
        """Go on with the view from another (4, 4) pose."""
        self._poses[view] = pose


class AlignedViews:
    """Views that a scene is not fitted to, from where it looks most like their photographs; the scene does not change.

    Once the poses of those that are fitted have moved, these are as far off as those were, and a comparison would
    measure that.
    """

    def __init__(
        self, rasterizer: Rasterizer, views: Sequence[TrainingView], background: Background, plan: PosePlan
    ) -> None:
        self._rasterizer = rasterizer
        self._given = views
        self._background = background
        self._plan = plan
        self._refinement = PoseRefinement([view.at(1)[1].world_to_camera for view in views], fixed_scene=True)
        self._aligned = False

    @property
    def poses(self) -> NDArray[np.float64]:
        """(V, 4, 4) world-to-camera in frame units."""
        return self._refinement.poses

    @property
    def views(self) -> list[TrainingView]:
        """The photographs with these poses."""
        return [view.moved(pose) for view, pose in zip(self._given, self.poses, strict=True)]

    def align(self, parameters: ParameterSet) -> None:
        """Move the poses to where the scene is now: from where they were given at first, then only after it."""
        plan = self._plan
        if self._aligned:
            rates = [plan.rate * plan.rate_left] * plan.follow_steps
        else:
            done = np.arange(plan.align_steps) / plan.align_steps
            rates = (plan.largest_rate * plan.rate_left**done).tolist()
        self._aligned = True
        for index, view in enumerate(self._given):
            _match(self._rasterizer, self._refinement, index, *view.at(1), parameters, self._background, rates)


def motion_to_match(
    rasterizer: Rasterizer,
    views: Sequence[TrainingView],
    reduction: int,
    parameters: ParameterSet,
    background: Background,
    plan: PosePlan,
) -> float:
    """How far views have to move to match a scene that stays as it is: RMS over them, in pixels of the full images.

    They do not come all the way where that is far: a pixel or two.
    """
    cameras = [view.at(1)[1] for view in views]
    refinement = PoseRefinement([camera.world_to_camera for camera in cameras], fixed_scene=True)
    left = plan.probe_left ** (np.arange(plan.probe_steps) / plan.probe_steps)
    for index, view in enumerate(views):
        rates = (plan.probe_rate / cameras[index].fx * left).tolist()
        _match(rasterizer, refinement, index, *view.at(reduction), parameters, background, rates)
    return refinement.image_motion(cameras)


def _match(
    rasterizer: Rasterizer,
    refinement: PoseRefinement,
    view: int,
    image: wp.array,
    camera: RasterCamera,
    parameters: ParameterSet,
    background: Background,
    rates: Sequence[float],
) -> None:
    """Move one view's pose to where the scene matches its photograph, in steps of these sizes."""
    for rate in rates:
        moved = refinement.camera(view, camera)
        frame = rasterizer.render(parameters, moved, background.color)
        rasterizer.photometric_loss(frame, image)
        refinement.step(view, parameters, rasterizer.backward(frame), moved, rate)


def _extent(poses: NDArray[np.float64]) -> float:
    """Root mean square distance of the cameras from their middle."""
    centers = np.einsum("vji,vj->vi", poses[:, :3, :3], -poses[:, :3, 3])
    return float(np.sqrt(centers.var(axis=0).sum())) or 1.0


def _coordinates(camera: RasterCamera) -> NDArray[np.float64]:
    """(6, 6) columns: motions (translation, rotation vector) in camera axes that move the image by about as much.

    Turns about x, y and z through the camera's centre; moves along z; and swings about x and y through the scene, which
    leave what is at its depth in place and show in the parallax alone.
    """
    # What is at the edge of the image moves by this share of what a turn of the camera about x or y moves everything.
    lever = np.hypot(camera.width / camera.fx, camera.height / camera.fy) / np.sqrt(12.0)
    columns = np.zeros((6, 6))
    columns[3, 0] = columns[4, 1] = 1.0
    columns[5, 2] = 1.0 / lever
    columns[2, 3] = _DEPTH / lever
    columns[3, 4], columns[1, 4] = 1.0, _DEPTH
    columns[4, 5], columns[0, 5] = 1.0, -_DEPTH
    return columns


def product_sums(first: wp.array | None, second: wp.array) -> NDArray[np.float64]:
    """(A, B) sums over the rows of products of an (N, A) and an (N, B) array's columns; A = 1 of ones for None."""
    right = wp.to_torch(second, requires_grad=False)
    if first is None:
        return right.sum(dim=0, keepdim=True).cpu().numpy().astype(np.float64)
    left = wp.to_torch(first, requires_grad=False)
    return (left.T @ right).cpu().numpy().astype(np.float64)


def _antisymmetric(products: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sum of cross products a x b from the (3, 3) sums of products of a's and b's components."""
    return np.array([products[1, 2] - products[2, 1], products[2, 0] - products[0, 2], products[0, 1] - products[1, 0]])


def _motion(twist: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) rigid: turned by the rotation vector `twist[3:]`, then moved by `twist[:3]`."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_rotvec(twist[3:]).as_matrix()
    result[:3, 3] = twist[:3]
    return result


def _in_world(twist: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The small motion of the world before `pose` that does what `twist` does after it, to first order."""
    rotation, translation = pose[:3, :3], pose[:3, 3]
    return np.concatenate([rotation.T @ (twist[:3] + np.cross(twist[3:], translation)), rotation.T @ twist[3:]])
