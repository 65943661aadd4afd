"""The rasteriser renders what the dense float64 reference renders, and its gradients are the reference's."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import warp as wp

from cvdgs.core.splats.raster import Gradients, ParameterSet, Rasterizer

from . import reference as reference

IMAGE_TOLERANCE = 5e-6  # absolute, colours and alpha are of order one
GRADIENT_TOLERANCE = 1e-5  # of the norm of a parameter group


def to_device(values: np.ndarray) -> wp.array:
    return wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.float32, device="cpu")


def cotangents(scene: reference.Scene, seed: int = 7) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    shape = (scene.camera.height, scene.camera.width)
    values = rng.normal(size=(*shape, 3)), 0.1 * rng.normal(size=shape), rng.normal(size=shape)
    return [value.astype(np.float32) for value in values]


def relative_error(value: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(value - expected) / np.linalg.norm(expected))


def assert_gradients(gradients: Gradients, expected: dict[str, np.ndarray]) -> None:
    for name, value in gradients.numpy().items():
        assert relative_error(value, expected[name]) < GRADIENT_TOLERANCE, name


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("count", "width", "height", "spread"),
    [(60, 32, 32, 1.0), (300, 51, 41, 2.0), (40, 7, 5, 1.0), (25, 130, 17, 0.5)],
)
def test_images_and_gradients_match_the_dense_reference(sh_degree, count, width, height, spread):
    scene = reference.random_scene(count, width, height, sh_degree=sh_degree, seed=count, spread=spread)
    rasterizer = Rasterizer(threads=2)
    frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera, scene.background)
    color, depth, alpha = (image.detach().numpy() for image in reference.render(scene))
    assert np.abs(frame.color.numpy() - color).max() < IMAGE_TOLERANCE
    assert np.abs(frame.depth.numpy() - depth).max() < IMAGE_TOLERANCE * 8.0  # the largest depth
    assert np.abs(frame.alpha.numpy() - alpha).max() < IMAGE_TOLERANCE

    c = cotangents(scene)
    gradients = rasterizer.backward(
        frame, grad_color=to_device(c[0]), grad_depth=to_device(c[1]), grad_alpha=to_device(c[2])
    )
    assert_gradients(gradients, reference.gradients(scene, c))


def test_gradients_of_colour_alone_match_the_dense_reference():
    scene = reference.random_scene(200, 45, 38, sh_degree=1, seed=5)
    rasterizer = Rasterizer(threads=2)
    frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera, scene.background)
    color = cotangents(scene)[0]
    gradients = rasterizer.backward(frame, grad_color=to_device(color))
    assert_gradients(gradients, reference.gradients(scene, [color, None, None]))


def test_a_perspective_beyond_the_field_of_view_is_linearised_at_its_margin():
    # Large Gaussians around the image: most centres lie where x / z or y / z is clamped.
    scene = reference.random_scene(80, 40, 30, seed=9, spread=4.0, beside=1.0)
    rasterizer = Rasterizer(threads=1)
    frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera, scene.background)
    assert np.abs(frame.color.numpy() - reference.render(scene)[0].detach().numpy()).max() < IMAGE_TOLERANCE
    c = cotangents(scene)
    gradients = rasterizer.backward(
        frame, grad_color=to_device(c[0]), grad_depth=to_device(c[1]), grad_alpha=to_device(c[2])
    )
    assert_gradients(gradients, reference.gradients(scene, c))


def test_colour_gradients_alone_are_the_degree_0_part_of_all_gradients():
    scene = reference.random_scene(150, 40, 33, sh_degree=2, seed=11)
    rasterizer = Rasterizer(threads=2)
    frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera, scene.background)
    color = to_device(cotangents(scene)[0])
    everything = rasterizer.backward(frame, grad_color=color).sh.numpy()[:, 0].copy()
    alone = rasterizer.backward(frame, grad_color=color, colors_only=True)
    assert alone.colors_only
    assert relative_error(alone.sh.numpy()[:, 0], everything) < 1e-6


def test_screen_gradients_are_those_of_the_projected_centres():
    scene = reference.random_scene(50, 48, 36, seed=13)
    camera = scene.camera
    rasterizer = Rasterizer(threads=2)
    frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), camera, scene.background)
    color = cotangents(scene)[0]
    gradients = rasterizer.backward(frame, grad_color=to_device(color), absolute=True)
    projected = {name: value.detach() for name, value in reference.project(scene).items()}
    projected["centers"].requires_grad_()
    image = reference.blend(camera, projected, scene.background)[0]
    (image * torch.from_numpy(color)).sum().backward()
    expected = np.linalg.norm(projected["centers"].grad.numpy() * [camera.width / 2, camera.height / 2], axis=1)
    assert relative_error(gradients.screen.numpy(), expected) < GRADIENT_TOLERANCE
    # Absolute sums over the pixels bound the norm of the sum from above.
    assert (gradients.screen_abs.numpy() >= gradients.screen.numpy() * (1 - 1e-4)).all()


def test_an_opaque_gaussian_saturates_and_hides_what_lies_behind():
    scene = reference.random_scene(30, 24, 24, seed=3, spread=3.0)
    scene.leaves["opacity_logits"].data += 9.0  # alpha reaches its cap of 0.999
    rasterizer = Rasterizer(threads=1)
    frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera, scene.background)
    assert np.abs(frame.color.numpy() - reference.render(scene)[0].detach().numpy()).max() < IMAGE_TOLERANCE
    c = cotangents(scene)
    gradients = rasterizer.backward(
        frame, grad_color=to_device(c[0]), grad_depth=to_device(c[1]), grad_alpha=to_device(c[2])
    )
    expected = reference.gradients(scene, c)
    for name, value in gradients.numpy().items():
        # 1 / (1 - alpha) amplifies rounding a thousandfold here.
        assert relative_error(value, expected[name]) < 1000 * GRADIENT_TOLERANCE, name


@pytest.mark.parametrize("count", [300, 6000])  # 6000 are sorted and binned by all threads
def test_the_bits_do_not_depend_on_the_run_or_on_the_number_of_threads(count):
    scene = reference.random_scene(count, 75, 53, sh_degree=1, seed=17)
    target = wp.array(np.random.default_rng(2).integers(0, 256, (53, 75, 3), np.uint8), dtype=wp.uint8, device="cpu")

    def run(rasterizer: Rasterizer) -> list[bytes]:
        frame = rasterizer.render(ParameterSet.from_gaussians(scene.gaussians), scene.camera, scene.background)
        loss = rasterizer.photometric_loss(frame, target)
        gradients = rasterizer.backward(frame, absolute=True)
        arrays = [frame.color, frame.depth, frame.alpha, frame.grad_color, gradients.screen, gradients.screen_abs]
        return [
            repr((loss.l1, loss.ssim)),
            *(a.numpy().tobytes() for a in (*arrays, *(getattr(gradients, n) for n in reference.FIELDS))),
        ]

    first = Rasterizer(threads=1)
    expected = run(first)
    assert run(first) == expected
    for threads in (2, 3):
        rasterizer = Rasterizer(threads=threads)
        for _ in range(3):
            assert run(rasterizer) == expected
