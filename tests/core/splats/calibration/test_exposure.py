"""Exposure that changes between photographs is found, kept out of the scene, and left alone where there is none."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.calibration.exposure import ExposureCorrection, ExposurePlan, estimate_log_gains
from cvdgs.core.splats.raster import Adam, LearningRates, ParameterSet, Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import Background, prepare_targets
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.trainer import Trainer

from .test_poses import ball, photographs

BLACK = Background((0.0, 0.0, 0.0))
STEPS = 480


@pytest.fixture(scope="module")
def scene():
    return ball()


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene, count=10, size=96, arc=1.0)


def lit(views, log_gains):
    """`views` as photographed with (V, 3) logarithms of gains, dark enough for none to clip."""
    images = [np.round(0.7 * view.image * np.exp(g)) for view, g in zip(views, log_gains, strict=True)]
    return [replace(v, image=np.clip(i, 0, 255).astype(np.uint8)) for v, i in zip(views, images, strict=True)]


def fit(views, scene) -> ExposureCorrection:
    """Colours, shapes and gains at once, starting from grey."""
    rasterizer, plan, rng = Rasterizer("cpu", 1), ExposurePlan(), np.random.default_rng(0)
    frame = SceneFrame.around(views, scene.means)
    targets = prepare_targets(rasterizer, views, frame, BLACK)
    grey = scene.with_base_colors(np.full((len(scene), 3), 0.4, np.float32))
    parameters = ParameterSet.from_gaussians(frame.from_world(grey))
    adam, exposure = Adam(parameters), ExposureCorrection(rasterizer.device, len(views))
    order: list[int] = []
    for step in range(STEPS):
        if step == round(plan.decided_at * STEPS):
            estimates = []
            for image, camera in (target.at(1) for target in targets):
                rendered = rasterizer.render(parameters, camera).color.numpy()
                estimates.append(estimate_log_gains(rendered, image.numpy() / np.float32(255)))
            exposure.start(estimates, plan.threshold)
        order = order or rng.permutation(len(views)).tolist()
        view = order.pop()
        image, camera = targets[view].at(1)
        rendered_frame = rasterizer.render(parameters, camera)
        exposure.apply(rendered_frame, view)
        rasterizer.photometric_loss(rendered_frame, image)
        exposure.backward(rendered_frame, view)
        gradients = rasterizer.backward(rendered_frame)
        adam.step(rasterizer, parameters, gradients, LearningRates(1e-4, 5e-3, 1e-3, 1e-2, 1e-2))
        exposure.step(view, plan.learning_rate_at(step / STEPS))
    return exposure


def test_known_gains_are_recovered_to_two_percent(views, scene):
    log_gains = np.random.default_rng(1).normal(0.0, 0.12, (len(views), 3))
    log_gains -= log_gains.mean(axis=0)
    exposure = fit(lit(views, log_gains), scene)
    assert exposure.active
    np.testing.assert_allclose(np.exp(exposure.log_gains - log_gains), 1.0, atol=0.02)
    np.testing.assert_allclose(exposure.log_gains.mean(axis=0), 0.0, atol=1e-5)


def test_photographs_that_agree_are_left_alone(views, scene):
    exposure = fit(lit(views, np.zeros((len(views), 3))), scene)
    assert not exposure.active
    np.testing.assert_array_equal(exposure.log_gains, 0.0)


@given(red=st.floats(0.5, 1.5), green=st.floats(0.5, 1.5), blue=st.floats(0.5, 1.5), seed=st.integers(0, 99))
@settings(deadline=None, max_examples=25)
def test_a_gain_is_estimated_in_spite_of_noise_and_of_what_is_missing(red, green, blue, seed):
    rng = np.random.default_rng(seed)
    image = rng.uniform(0.2, 0.6, (96, 96, 3)).astype(np.float32)
    gains = np.array([red, green, blue], np.float32)
    photograph = image * gains + rng.normal(0.0, 0.05, image.shape).astype(np.float32)
    image[:40, :40] = 0.0  # nothing was reconstructed there
    photograph[60:, :30] = 1.0  # and here something passed by
    np.testing.assert_allclose(np.exp(estimate_log_gains(image, photograph)), gains, rtol=0.03)


def test_an_image_too_small_or_too_dark_to_tell_has_no_gain():
    np.testing.assert_array_equal(estimate_log_gains(np.ones((20, 20, 3)), np.ones((20, 20, 3)) / 2), 0.0)
    np.testing.assert_array_equal(estimate_log_gains(np.zeros((200, 200, 3)), np.ones((200, 200, 3))), 0.0)


def test_the_gradient_is_that_of_a_finite_difference_and_the_frame_is_as_before(views, scene):
    rasterizer = Rasterizer("cpu", 1)
    frame = SceneFrame.around(views, scene.means)
    image, camera = prepare_targets(rasterizer, views[:1], frame, BLACK)[0].at(1)
    parameters = ParameterSet.from_gaussians(frame.from_world(scene.with_base_colors(0.8 * scene.base_colors)))

    def loss(log_gains: np.ndarray, *, back: bool = False) -> tuple[float, ExposureCorrection]:
        exposure = ExposureCorrection(rasterizer.device, 2)
        exposure.start([log_gains, -log_gains], 0.0)
        rendered = rasterizer.render(parameters, camera)
        plain = rendered.color.numpy().copy()
        exposure.apply(rendered, 0)
        total = rasterizer.photometric_loss(rendered, image).total
        if back:
            slope = rendered.grad_color.numpy().copy()
            exposure.backward(rendered, 0)
            np.testing.assert_allclose(rendered.color.numpy(), plain, atol=1e-6)
            np.testing.assert_allclose(rendered.grad_color.numpy(), slope * np.exp(log_gains), rtol=1e-4, atol=1e-12)
        return total, exposure

    at = np.array([0.1, -0.05, 0.2])
    _, exposure = loss(at, back=True)
    for channel in range(3):
        nudge = 1e-2 * np.eye(3)[channel]
        expected = (loss(at + nudge)[0] - loss(at - nudge)[0]) / 2e-2
        assert exposure.gradient[channel] == pytest.approx(expected, rel=0.03)


def test_a_gradient_that_is_no_number_moves_nothing():
    exposure = ExposureCorrection(wp.get_device("cpu"), 2)
    exposure.start([np.full(3, 0.1), np.full(3, -0.1)], 0.01)
    before = exposure.log_gains
    exposure.gradient = exposure.gradient + float("nan")
    exposure.step(0, 0.01)
    np.testing.assert_array_equal(exposure.log_gains, before)


def test_odd_exposures_of_the_views_that_decide_do_not_end_a_run(views, scene):
    """As the scene gets better it looks ever less like photographs whose exposure is odd."""
    log_gains = np.full((len(views), 3), 0.1)
    log_gains[::2] = -0.6
    photographed = lit(views, log_gains)
    plan = TrainingPlan(steps=300, limit=400, sh_degree=0)
    colors = np.full((len(scene), 3), 128, np.uint8)
    trainer = Trainer(
        Rasterizer("cpu", 1), photographed[1:], photographed[:1], scene.means, colors, plan, BLACK, seed=0
    )
    decision = trainer.train(Reporter()).decision
    assert decision["exposure"].startswith("corrected")
    assert decision["steps"] == "300 of 300"
