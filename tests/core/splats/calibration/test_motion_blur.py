"""Motion blur: lines are found, their gradients are right, and a scene becomes sharper than its photographs."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import gaussian_filter, shift

from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.calibration.corrections import Proposal, ViewCorrections
from cvdgs.core.splats.calibration.motion_blur import (
    MotionBlur,
    MotionBlurPlan,
    best_line,
    line_kernel,
    line_slopes,
    sharpened,
    smeared,
    smeared_array,
)
from cvdgs.core.splats.raster import ParameterSet, Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import prepare_targets
from cvdgs.core.splats.training.decisions import StopRule
from cvdgs.core.splats.training.plan import TrainingPlan, TrainingResult
from cvdgs.core.splats.training.trainer import Trainer

from ..raster.reference import random_scene
from .test_poses import BLACK, ball, photographs

LINES = [(6.0, 3.0), (0.0, 9.0), (-2.5, 2.5), (14.0, -1.0)]


def picture(width: int = 320, height: int = 240) -> np.ndarray:
    """Smooth noise in [0, 1]."""
    noise = gaussian_filter(np.random.default_rng(0).random((height, width, 3)), (2, 2, 0))
    return ((noise - noise.min()) / np.ptp(noise)).astype(np.float32)


def moved_about(image: np.ndarray, line: tuple[float, float], samples: int = 60) -> np.ndarray:
    """The mean of the image moved along a line, by scipy."""
    offsets = np.linspace(-0.5, 0.5, samples)
    moved = (shift(image, (t * line[1], t * line[0], 0.0), order=1, mode="nearest") for t in offsets)
    return (sum(moved) / samples).astype(np.float32)


def smeared_views(views, pixels: float):
    """`views` smeared along lines of this length in directions that go round."""
    angles = np.arange(len(views)) * 2.4
    lines = pixels * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    images = (np.round(moved_about(v.image.astype(np.float32), line)) for v, line in zip(views, lines, strict=True))
    return [replace(v, image=i.astype(np.uint8)) for v, i in zip(views, images, strict=True)], lines


def train(scene, training, held_out, **settings) -> TrainingResult:
    plan = TrainingPlan(**{"steps": 400, "limit": 800, "poses": None, "exposure": None, "curve_points": 1, **settings})
    grey = np.full((len(scene), 3), 128, np.uint8)
    return Trainer(Rasterizer("cpu", 1), training, held_out, scene.means, grey, plan, BLACK, 0).train(Reporter())


@pytest.mark.parametrize("line", LINES)
def test_a_line_averages_what_a_camera_sees_while_it_moves(line):
    image = picture(64, 48)
    np.testing.assert_allclose(smeared_array(image, np.array(line)), moved_about(image, line), atol=0.02)
    assert line_kernel(np.array(line)).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("line", LINES)
def test_the_slopes_of_a_kernel_are_its_differences(line):
    line, step = np.array(line) + 0.013, 1e-5
    for axis, slope in enumerate(line_slopes(line)):
        around = [line_kernel(line + sign * step * np.eye(2)[axis]) for sign in (1, -1)]
        np.testing.assert_allclose(slope, (around[0] - around[1]) / (2 * step), atol=1e-6)


def test_the_gradient_of_a_smeared_frame_is_that_of_autograd_sharpened():
    scene, line = random_scene(40, 48, 40, seed=1), np.array([5.3, -2.2])
    frame = Rasterizer("cpu", 1).render(ParameterSet.from_gaussians(scene.gaussians), scene.camera)
    cotangent = np.random.default_rng(1).normal(size=frame.color.shape).astype(np.float32)
    sharp = frame.color.numpy().copy()
    blur = MotionBlur(frame.color.device, 1)
    blur.start([2.0 * line])  # the frame is of half the size
    blur.apply(frame, 0, 2.0)
    np.testing.assert_allclose(frame.color.numpy(), smeared_array(sharp, line), atol=1e-6)
    frame.grad_color.assign(wp.array(cotangent, dtype=wp.float32))
    blur.backward(frame, 0, 2.0)
    image = torch.from_numpy(sharp).requires_grad_()
    radius = line_kernel(line).shape[0] // 2
    padded = torch.nn.functional.pad(image.permute(2, 0, 1)[:, None], [radius] * 4, mode="replicate")
    kernel = torch.from_numpy(line_kernel(line).astype(np.float32))[None, None]
    (torch.nn.functional.conv2d(padded, kernel)[:, 0].permute(1, 2, 0) * torch.from_numpy(cotangent)).sum().backward()
    np.testing.assert_allclose(frame.grad_color.numpy(), sharpened(image.grad, line).numpy(), atol=1e-5)
    np.testing.assert_array_equal(frame.color.numpy(), sharp)


@given(
    st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0)),
    arrays(np.float32, (16, 20, 1), elements=st.floats(-1.0, 1.0, width=32)),
)
def test_the_loss_falls_along_a_sharpened_gradient(line, values):
    gradient = torch.from_numpy(values)
    assert float((gradient * sharpened(gradient, np.array(line))).sum()) >= 0.9 * float(gradient.square().sum())


@pytest.mark.parametrize("line", LINES)
def test_sharpened_gradients_bring_back_detail_sooner(line):
    line, sharp = np.array(line), torch.from_numpy(picture(96, 72))
    photograph = smeared(sharp, line)

    def left(change) -> float:
        image = photograph.clone()
        for _ in range(20):
            image -= 0.9 * change(smeared(smeared(image, line) - photograph, line))
        return float((image - sharp).square().mean())

    assert left(lambda gradient: sharpened(gradient, line)) < 0.8 * left(lambda gradient: gradient)


@pytest.mark.parametrize("line", LINES)
def test_the_line_of_a_photograph_is_found(line):
    found = best_line(picture(), moved_about(picture(), line))
    assert min(np.linalg.norm(found - line), np.linalg.norm(found + line)) < 1.3


def test_no_line_makes_a_soft_rendering_more_like_a_sharp_photograph():
    soft = gaussian_filter(picture(), (1.5, 1.5, 0))
    np.testing.assert_array_equal(best_line(soft, picture()), 0.0)


def test_what_is_masked_tells_nothing_of_a_line():
    photograph, shown = picture(), np.ones((240, 320), bool)
    shown[:, 160:] = False
    photograph[:, 160:] = moved_about(picture(), (20.0, 0.0))[:, 160:]
    np.testing.assert_array_equal(best_line(picture(), photograph, shown), 0.0)


def test_one_hears_how_far_the_search_for_lines_is():
    scene = ball()
    views, _ = smeared_views(photographs(scene, count=20, size=96), 7.0)
    rasterizer, frame = Rasterizer("cpu", 1), SceneFrame.around(views, scene.means)
    targets = prepare_targets(rasterizer, views, frame, BLACK)
    corrections = ViewCorrections(rasterizer, targets, BLACK, None, None, MotionBlurPlan(), steps=400)
    heard: list[str] = []
    proposed = corrections.decide(0.3, ParameterSet.from_gaussians(frame.from_world(scene)), heard.append)
    assert proposed == [Proposal.BLUR]
    assert [words.rpartition("view ")[2] for words in heard] == [f"{i + 1} of 20" for i in range(20)]


@pytest.mark.slow  # 6 s of training
def test_a_scene_is_sharper_than_the_smeared_photographs_it_is_made_of():
    scene = ball()
    sharp = photographs(scene, count=30, size=96)
    given, lines = smeared_views(sharp, 7.0)
    training, held_out = given[:-3], sharp[-3:]
    clear, plain = (train(scene, training, held_out, stopping=StopRule(), **s) for s in ({}, {"blur": None}))
    assert clear.decision["motion_blur"].startswith("corrected")
    assert "trial" in clear.decision["motion_blur"]
    assert clear.curve[-1]["psnr"] > plain.curve[-1]["psnr"] + 1.0
    found = np.stack([clear.smears[view.key] for view in training])
    apart = np.minimum(*(np.linalg.norm(found - sign * lines[:-3], axis=1) for sign in (1, -1)))
    assert np.median(apart) < 2.5
    assert all(np.linalg.norm(clear.smears[view.key]) < 5.0 for view in held_out)  # which are sharp
    assert plain.smears == {}


@pytest.mark.slow
def test_sharp_photographs_are_taken_as_they_are():
    scene = ball()
    views = photographs(scene, count=30, size=96)
    tried, plain = (train(scene, views[:-3], views[-3:], **settings) for settings in ({}, {"blur": None}))
    assert tried.smears == {}
    assert tried.curve[-1]["psnr"] > plain.curve[-1]["psnr"] - 0.05
