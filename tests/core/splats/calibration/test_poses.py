"""Refining poses: the gradient against autograd, poses that are off come back, and good ones stay."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
import warp as wp
from scipy.spatial.transform import Rotation

from cvdgs.core.capture.model import PinholeCamera, View
from cvdgs.core.splats.calibration.poses import AlignedViews, PosePlan, PoseRefinement, pose_gradient
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.raster import Adam, LearningRates, ParameterSet, Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import Background, TrainingView, prepare_targets

from ..raster.reference import blend, project, random_scene

BLACK = Background((0.0, 0.0, 0.0))


def generator(axis: int) -> np.ndarray:
    """(4, 4) derivative of a motion: 0..2 translations along x, y, z, and 3..5 rotations about them."""
    result = np.zeros((4, 4))
    if axis < 3:
        result[axis, 3] = 1.0
    else:
        result[:3, :3] = np.cross(np.eye(3)[axis - 3], np.eye(3)).T
    return result


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_gradient_is_that_of_autograd(seed):
    scene = random_scene(40, 48, 40, seed=seed)
    cotangent = np.random.default_rng(seed).normal(size=(40, 48, 3)).astype(np.float32)
    pose = torch.from_numpy(scene.camera.world_to_camera).requires_grad_()
    color, _, _ = blend(scene.camera, project(scene, pose), scene.background)
    (slope,) = torch.autograd.grad((color * torch.from_numpy(cotangent)).sum(), pose)
    expected = [(slope.numpy() * (generator(axis) @ scene.camera.world_to_camera)).sum() for axis in range(6)]
    rasterizer, parameters = Rasterizer("cpu", 1), ParameterSet.from_gaussians(scene.gaussians)
    frame = rasterizer.render(parameters, scene.camera, scene.background)
    gradients = rasterizer.backward(frame, grad_color=wp.array(cotangent, dtype=wp.float32))
    result = pose_gradient(parameters, gradients, scene.camera.world_to_camera)
    np.testing.assert_allclose(result, expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max())


def ball(count: int = 500, seed: int = 0) -> Gaussians:
    """Opaque coloured Gaussians in a ball of radius one, denser towards its surface."""
    rng = np.random.default_rng(seed)
    means = rng.standard_normal((count, 3))
    means *= rng.uniform(0.3, 1.0, (count, 1)) ** (1 / 3) / np.linalg.norm(means, axis=1, keepdims=True)
    return Gaussians(
        means=means.astype(np.float32),
        log_scales=np.log(rng.uniform(0.05, 0.18, (count, 3))).astype(np.float32),
        quaternions=rng.standard_normal((count, 4)).astype(np.float32),
        opacity_logits=np.full(count, 3.0, np.float32),
        sh=((rng.uniform(0.0, 1.0, (count, 1, 3)) - 0.5) / SH_C0).astype(np.float32),
    )


def photographs(scene: Gaussians, count: int = 24, size: int = 144, arc: float = 2.0 * np.pi) -> list[View]:
    """Views of `scene` from a wavy ring around it, or from an arc of so many radians of one."""
    camera = PinholeCamera(size, size, 1.1 * size, 1.1 * size, size / 2, size / 2)
    views = []
    for i, angle in enumerate(np.arange(count) * arc / count):
        position = np.array([3.0 * np.cos(angle), 3.0 * np.sin(angle), 1.2 * np.sin(2.1 * i)])
        forward = -position / np.linalg.norm(position)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
        pose[:3, 3] = -pose[:3, :3] @ position
        views.append(View(f"{i:02d}", Path(f"{i}.png"), camera, pose, np.zeros((size, size, 3), np.uint8)))
    renderer = SceneRenderer(Rasterizer("cpu", 1), views, BLACK)
    return [replace(view, image=renderer.color(scene, i)) for i, view in enumerate(views)]


def turned(views: list[View], degrees: float) -> list[View]:
    """`views` whose cameras believe to be turned by `degrees` about random axes through their centres."""
    axes = np.random.default_rng(3).standard_normal((len(views), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    motions = np.tile(np.eye(4), (len(views), 1, 1))
    motions[:, :3, :3] = Rotation.from_rotvec(np.radians(degrees) * axes).as_matrix()
    return [replace(v, world_to_camera=m @ v.world_to_camera) for v, m in zip(views, motions, strict=True)]


def errors(views: list[View], truth: list[View], points: np.ndarray) -> tuple[float, float]:
    """Mean angle in degrees and RMS distance in pixels of `points`, after undoing what the views have in common."""
    world = np.stack([np.linalg.inv(t.world_to_camera) @ v.world_to_camera for v, t in zip(views, truth, strict=True)])
    common = np.eye(4)
    common[:3, :3] = Rotation.from_matrix(world[:, :3, :3]).mean().as_matrix()
    common[:3, 3] = world[:, :3, 3].mean(axis=0)
    angles, squares = [], []
    for view, true in zip(views, truth, strict=True):
        pose = view.world_to_camera @ np.linalg.inv(common)
        angles.append(Rotation.from_matrix(pose[:3, :3] @ true.world_to_camera[:3, :3].T).magnitude())
        first, second = (points @ p[:3, :3].T + p[:3, 3] for p in (pose, true.world_to_camera))
        offset = first[:, :2] / first[:, 2:] - second[:, :2] / second[:, 2:]
        squares.append((view.camera.fx * offset) ** 2)
    return float(np.degrees(np.mean(angles))), float(np.sqrt(np.sum(squares, axis=2).mean()))


class Fitted(NamedTuple):
    """What `refine` gives."""

    poses: PoseRefinement
    frame: SceneFrame
    parameters: ParameterSet
    targets: list[TrainingView]


def refine(views: list[View], scene: Gaussians, steps: int, until: float = 1.0, *, moves: bool = True) -> Fitted:
    """Fit Gaussians, and poses at once if they move, from noisy grey points until `until` of `steps` is done."""
    plan, rng, rasterizer = PosePlan(), np.random.default_rng(0), Rasterizer("cpu", 1)
    frame = SceneFrame.around(views, scene.means)
    targets = prepare_targets(rasterizer, views, frame, BLACK)
    start = replace(
        scene.with_base_colors(np.full((len(scene), 3), 0.4, np.float32)),
        means=scene.means + rng.normal(0.0, 0.02, scene.means.shape).astype(np.float32),
        log_scales=np.full_like(scene.log_scales, np.log(0.1)),
        opacity_logits=np.zeros_like(scene.opacity_logits),
    )
    parameters = ParameterSet.from_gaussians(frame.from_world(start))
    adam = Adam(parameters)
    poses = PoseRefinement([frame.world_to_camera(view.world_to_camera) for view in views])
    order: list[int] = []
    for step in range(round(until * steps)):
        order = order or rng.permutation(len(views)).tolist()
        view = order.pop()
        image, camera = targets[view].at(1)
        camera = poses.camera(view, camera)
        frame_now = rasterizer.render(parameters, camera)
        rasterizer.photometric_loss(frame_now, image)
        gradients = rasterizer.backward(frame_now)
        if moves and step >= 0.02 * steps:
            poses.step(view, parameters, gradients, camera, plan.learning_rate_at(step / steps, steps / len(views)))
        left = 0.2 ** (step / steps)
        rates = LearningRates(6.4e-4 * 0.02 ** (step / steps), 2e-2 * left, 4e-3 * left, 1e-1 * left, 1e-2 * left)
        adam.step(rasterizer, parameters, gradients, rates)
    return Fitted(poses, frame, parameters, targets)


@pytest.fixture(scope="module")
def scene():
    return ball()


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene)


def test_poses_half_a_degree_off_come_back(scene, views):
    given = turned(views, 0.5)
    poses, frame, *_ = refine(given, scene, steps=720)
    refined = [view.at(frame.pose_to_world(pose)) for view, pose in zip(given, poses.poses, strict=True)]
    before, after = errors(given, views, scene.means), errors(refined, views, scene.means)
    assert before[0] > 0.45
    assert after[0] < 0.3 * before[0]
    assert after[1] < 0.2 * before[1]


@pytest.mark.parametrize("steps", [240, 720])
@pytest.mark.parametrize(("after", "farthest", "turned_by"), [(*PosePlan.checks[0], 1.0), (*PosePlan.checks[1], 0.25)])
def test_a_rough_scene_tells_good_poses_from_those_that_are_off(scene, views, steps, after, farthest, turned_by):
    """A quarter of a degree is three quarters of a pixel here."""
    good, off = (
        AlignedViews(Rasterizer("cpu", 1), fitted.targets[::3], BLACK, PosePlan()).motion_to_match(fitted.parameters, 1)
        for fitted in (refine(given, scene, steps, after, moves=False) for given in (views, turned(views, turned_by)))
    )
    assert good < 0.9 * farthest
    assert off > 1.1 * farthest


@pytest.mark.parametrize("degrees", [0.25, 1.0])
def test_views_are_roughly_aligned_with_a_scene_at_half_their_size(scene, views, degrees):
    given, rasterizer = turned(views, degrees), Rasterizer("cpu", 1)
    frame = SceneFrame.around(given, scene.means)
    targets = prepare_targets(rasterizer, given, frame, BLACK, {2})
    aligned = AlignedViews(rasterizer, targets, BLACK, PosePlan())
    aligned.align_roughly(ParameterSet.from_gaussians(frame.from_world(scene)), 2)
    found = [view.at(frame.pose_to_world(pose)) for view, pose in zip(given, aligned.poses, strict=True)]
    assert errors(found, views, scene.means)[1] < 0.25 * errors(given, views, scene.means)[1]


def test_the_views_as_a_whole_neither_move_nor_grow(scene, views):
    given = turned(views, 0.5)
    poses, frame, *_ = refine(given, scene, steps=720, until=0.1)
    before, after = (
        np.stack([np.linalg.inv(p)[:3, 3] for p in x])
        for x in (poses.poses, [frame.world_to_camera(v.world_to_camera) for v in given])
    )
    moved = np.abs(after - before).max()
    assert moved > 1e-4
    assert np.linalg.norm(after.mean(axis=0) - before.mean(axis=0)) < 0.1 * moved
    assert after.var(axis=0).sum() == pytest.approx(before.var(axis=0).sum(), rel=1e-5)


@pytest.mark.parametrize("grown", [1.0, 1.1])
def test_poses_that_are_taken_over_leave_the_views_as_a_whole_where_they_are(scene, views, grown):
    wanted, common = turned(views, 0.5), np.eye(4)
    common[:3, :3], common[:3, 3] = Rotation.from_rotvec([0.02, 0.0, -0.01]).as_matrix(), [0.03, -0.02, 0.01]
    poses = np.stack([view.world_to_camera @ common for view in wanted])
    poses[:, :3, 3] *= grown
    refinement = PoseRefinement([view.world_to_camera for view in views])
    refinement.go_to(poses)
    taken = [view.at(pose) for view, pose in zip(views, refinement.poses, strict=True)]
    given, after = (np.stack([np.linalg.inv(v.world_to_camera)[:3, 3] for v in some]) for some in (views, taken))
    assert np.abs(after.mean(axis=0) - given.mean(axis=0)).max() < 0.01
    assert after.var(axis=0).sum() == pytest.approx(given.var(axis=0).sum(), rel=1e-6)
    assert errors(taken, wanted, scene.means)[0] < 0.05
    assert errors(taken, views, scene.means)[0] == pytest.approx(0.5, abs=0.05)


def test_a_pose_to_the_frame_and_back_is_the_same(views):
    frame = SceneFrame(np.array([1.0, -2.0, 3.0]), 0.4)
    pose = views[5].world_to_camera
    np.testing.assert_allclose(frame.pose_to_world(frame.world_to_camera(pose)), pose, atol=1e-12)
