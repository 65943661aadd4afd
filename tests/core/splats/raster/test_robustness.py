"""Degenerate input neither stops the rasteriser nor spreads to what is sound."""

from __future__ import annotations

import gc
import threading

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import Adam, LearningRates, ParameterSet, RasterCamera, Rasterizer

from ....patience import SOON
from . import reference as reference

RATES = LearningRates(*[1e-2] * 6)
BAD = [np.nan, np.inf, -np.inf, 3e38, -3e38, 1e20]
WIDTH, HEIGHT = 37, 29


def train_a_step(scene: reference.Scene, gaussians: Gaussians):
    """Image, gradients and parameters after one step towards grey."""
    rasterizer = Rasterizer(threads=2)
    params = ParameterSet.from_gaussians(gaussians)
    optimizer = Adam(params)
    camera = scene.camera
    frame = rasterizer.render(params, camera, scene.background)
    target = wp.full((camera.height, camera.width, 3), 128, dtype=wp.uint8, device="cpu")
    loss = rasterizer.photometric_loss(frame, target)
    gradients = rasterizer.backward(frame, absolute=True)
    optimizer.step(rasterizer, params, gradients, RATES)
    return frame, loss, gradients, params.numpy()


@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_a_gaussian_that_is_not_finite_is_culled_and_the_others_do_not_notice(data):
    scene = reference.random_scene(40, WIDTH, HEIGHT, sh_degree=1, seed=2)
    broken = {name: value.detach().numpy().astype(np.float32) for name, value in scene.leaves.items()}
    bad = sorted(data.draw(st.sets(st.integers(0, 39), min_size=1, max_size=8)))
    for n in bad:
        name = data.draw(st.sampled_from(["means", "log_scales", "quaternions", "sh"]))
        flat = broken[name].reshape(40, -1)
        flat[n, data.draw(st.integers(0, flat.shape[1] - 1))] = data.draw(st.sampled_from(BAD[:3]))
    sound = np.setdiff1d(np.arange(40), bad)
    whole = Gaussians(**broken)
    remaining = Gaussians(**{name: value[sound] for name, value in broken.items()})

    frame, loss, gradients, moved = train_a_step(scene, whole)
    expected_frame, expected_loss, expected_gradients, expected_moved = train_a_step(scene, remaining)
    assert not frame.visible.numpy()[bad].any()
    assert (loss.l1, loss.ssim) == (expected_loss.l1, expected_loss.ssim)
    np.testing.assert_array_equal(frame.color.numpy(), expected_frame.color.numpy())
    for name, value in gradients.numpy().items():
        assert not value[bad].any()
        np.testing.assert_array_equal(value[sound], expected_gradients.numpy()[name])
        np.testing.assert_array_equal(moved[name][sound], expected_moved[name])
        np.testing.assert_array_equal(moved[name][bad], broken[name][bad])


@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_whatever_the_parameters_images_and_gradients_are_finite(data):
    scene = reference.random_scene(20, WIDTH, HEIGHT, sh_degree=1, seed=4)
    values = {name: value.detach().numpy().astype(np.float32) for name, value in scene.leaves.items()}
    extreme = st.one_of(st.sampled_from(BAD), st.floats(-200.0, 200.0, width=32), st.floats(width=32))
    for name in reference.FIELDS:
        flat = values[name].reshape(20, -1)
        for n in data.draw(st.sets(st.integers(0, 19), max_size=6)):
            flat[n, data.draw(st.integers(0, flat.shape[1] - 1))] = data.draw(extreme)
    frame, loss, gradients, _ = train_a_step(scene, Gaussians(**values))
    if (np.abs(values["sh"]) < 1e18).all():  # colours may be absurd, but products of theirs must not overflow
        assert np.isfinite(frame.color.numpy()).all()
        assert np.isfinite([loss.total, loss.l1, loss.ssim]).all()
    assert np.isfinite(frame.alpha.numpy()).all()
    for name, value in gradients.numpy().items():
        assert np.isfinite(value).all(), name
    assert np.isfinite(gradients.screen.numpy()).all()
    assert np.isfinite(gradients.screen_abs.numpy()).all()


def test_without_gaussians_the_background_is_seen():
    scene = reference.random_scene(0, 21, 13)
    frame, loss, gradients, _ = train_a_step(scene, scene.gaussians)
    np.testing.assert_allclose(frame.color.numpy(), np.broadcast_to(np.float32(scene.background), (13, 21, 3)))
    assert not frame.alpha.numpy().any()
    assert loss.l1 > 0.0
    assert len(gradients) == 0


def test_one_gaussian_is_drawn():
    scene = reference.random_scene(1, 24, 24, seed=1, spread=0.2, beside=-0.4)
    frame, *_ = train_a_step(scene, scene.gaussians)
    assert frame.visible.numpy()[0]
    np.testing.assert_allclose(frame.color.numpy(), reference.render(scene)[0].detach().numpy(), atol=5e-6)


def test_gaussians_behind_the_camera_or_nearer_than_the_near_plane_are_culled():
    scene = reference.random_scene(60, 30, 30, seed=6)
    camera = scene.camera
    behind = RasterCamera(
        *(getattr(camera, n) for n in ("width", "height", "fx", "fy", "cx", "cy")),
        np.diag([-1.0, 1.0, -1.0, 1.0]) @ camera.world_to_camera,  # turned round
    )
    frame = Rasterizer(threads=1).render(ParameterSet.from_gaussians(scene.gaussians), behind)
    assert not frame.visible.numpy().any()
    assert not frame.alpha.numpy().any()
    far = RasterCamera(
        *(getattr(camera, n) for n in ("width", "height", "fx", "fy", "cx", "cy")), camera.world_to_camera, near=100.0
    )
    assert not Rasterizer(threads=1).render(ParameterSet.from_gaussians(scene.gaussians), far).alpha.numpy().any()


@pytest.mark.parametrize(("width", "height"), [(1, 1), (3, 2), (8, 16), (9, 17), (1, 50)])
def test_images_of_any_size_are_rendered(width, height):
    scene = reference.random_scene(30, width, height, seed=8, spread=2.0)
    frame, *_ = train_a_step(scene, scene.gaussians)
    np.testing.assert_allclose(frame.color.numpy(), reference.render(scene)[0].detach().numpy(), atol=5e-6)


def test_workspaces_follow_the_scene():
    rasterizer = Rasterizer(threads=2)
    for count, size, degree in [(50, 20, 0), (5000, 60, 1), (10, 33, 0), (0, 20, 0), (300, 60, 2), (300, 60, 0)]:
        scene = reference.random_scene(count, size, size, sh_degree=degree, seed=count, spread=2.0)
        frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera, scene.background)
        if count <= 300:
            np.testing.assert_allclose(frame.color.numpy(), reference.render(scene)[0].detach().numpy(), atol=5e-6)
        gradients = rasterizer.backward(frame)
        assert gradients.sh.shape == (count, (degree + 1) ** 2, 3)


def test_parameters_are_a_copy_and_their_numpy_arrays_are_views():
    gaussians = reference.random_scene(4, 8, 8).gaussians
    params = ParameterSet.from_gaussians(gaussians)
    params.numpy()["means"][:] = 7.0
    assert (params.to_gaussians().means == 7.0).all()
    assert not (gaussians.means == 7.0).any()


def test_an_error_in_a_worker_reaches_the_caller():
    from cvdgs.core.splats.raster.runner_cpu import WorkerPool

    def fail() -> None:
        raise ZeroDivisionError

    pool = WorkerPool(3)
    done: list[int] = []
    for _ in range(3):  # the pool stays usable
        with pytest.raises(ZeroDivisionError):
            pool.run([lambda: done.append(1), fail, lambda: done.append(2)])
    assert sorted(done) == [1, 1, 1, 2, 2, 2]


def test_a_rasterizer_takes_its_threads_along_when_it_goes():
    before = set(threading.enumerate())  # of which some may end meanwhile, with rasterizers of other tests
    rasterizer = Rasterizer(threads=4)
    workers = [t for t in threading.enumerate() if t.name == "raster" and t not in before]
    assert len(workers) == 3
    del rasterizer
    gc.collect()
    for worker in workers:
        worker.join(timeout=SOON)
        assert not worker.is_alive()
