"""The fused loss is L1 and SSIM as float64 torch computes them, and its gradient is theirs."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as F
import warp as wp

from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import Mask, ParameterSet, RasterCamera, Rasterizer

WINDOW, SIGMA, C1, C2 = 11, 1.5, 0.01**2, 0.03**2
SIZES = [(40, 33), (7, 5), (1, 1), (11, 100), (96, 64), (65, 31)]


def ssim_map(x: torch.Tensor, y: torch.Tensor, c2: float = C2) -> torch.Tensor:
    """(3, H, W) in the same shape: Wang et al. 2004 with zero padding, by plain two-dimensional convolutions."""
    offsets = torch.arange(WINDOW, dtype=torch.float64) - WINDOW // 2
    window = torch.exp(-(offsets**2) / (2 * SIGMA**2))
    window = (window / window.sum())[:, None] * (window / window.sum())[None]

    def blur(image: torch.Tensor) -> torch.Tensor:
        return F.conv2d(image[:, None], window[None, None], padding=WINDOW // 2)[:, 0]

    mx, my = blur(x), blur(y)
    vx, vy, vxy = blur(x * x) - mx**2, blur(y * y) - my**2, blur(x * y) - mx * my
    return (2 * mx * my + C1) * (2 * vxy + c2) / ((mx**2 + my**2 + C1) * (vx + vy + c2))


def expected_loss(x: np.ndarray, y: np.ndarray, weight: float, mask: np.ndarray | None, noise: float = 0.0):
    color = torch.from_numpy(x.astype(np.float64)).requires_grad_()
    target = torch.from_numpy(y.astype(np.float64))
    m = torch.ones(x.shape[:2], dtype=torch.float64) if mask is None else torch.from_numpy(mask.astype(np.float64))
    a, b = color * m[..., None], target * m[..., None]
    l1 = (a - b).abs().sum() / (3 * m.sum())
    ssim = (ssim_map(a.permute(2, 0, 1), b.permute(2, 0, 1), C2 + 2.0 * noise**2) * m).sum() / (3 * m.sum())
    total = (1 - weight) * l1 + weight * (1 - ssim)
    total.backward()
    return float(total.detach()), float(l1.detach()), float(ssim.detach()), color.grad.numpy()


def frame_showing(rasterizer: Rasterizer, image: np.ndarray):
    """A frame whose colour is `image`: there are no Gaussians, and frames are plain memory on the CPU."""
    height, width = image.shape[:2]
    empty = Gaussians(*(np.zeros((0, *shape), np.float32) for shape in ((3,), (3,), (4,), (), (1, 3))))
    camera = RasterCamera(width, height, width, width, width / 2, height / 2, np.eye(4))
    frame = rasterizer.render(ParameterSet.from_gaussians(empty), camera)
    frame.color.numpy()[:] = image
    return frame


def images(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """A smooth image with texture and a disturbed copy of it, in [0, 1]."""
    rng = np.random.default_rng(width * 1000 + height)
    y, x = np.mgrid[:height, :width] / 12.0
    smooth = np.stack([np.sin(x + 0.3 * c) * np.cos(y * (1 + c)) for c in range(3)], 2) * 0.4 + 0.5
    noisy = smooth + 0.1 * rng.normal(size=smooth.shape)
    return noisy.clip(0, 1).astype(np.float32), np.round(smooth * 255).astype(np.uint8)


def masks(width: int, height: int) -> dict[str, np.ndarray | None]:
    rng = np.random.default_rng(4)
    soft = rng.uniform(size=(height, width)).astype(np.float32)
    hard = (rng.uniform(size=(height, width)) > 0.3).astype(np.uint8) * 255
    hard[0, 0] = 255
    return {"none": None, "soft": soft, "bytes": hard}


@pytest.mark.parametrize("mask_name", ["none", "soft", "bytes"])
@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize(("weight", "noise"), [(0.2, 0.0), (1.0, 0.0), (0.4, 0.05)])
def test_value_and_gradient_match_float64(width, height, mask_name, weight, noise):
    x, photograph = images(width, height)
    mask = masks(width, height)[mask_name]
    rasterizer = Rasterizer(threads=2)
    frame = frame_showing(rasterizer, x)
    as_float = None if mask is None else (mask / 255.0 if mask.dtype == np.uint8 else mask)
    total, l1, ssim, gradient = expected_loss(x, photograph / 255.0, weight, as_float, noise)
    given_mask = None if mask is None else Mask.of(mask)
    loss = rasterizer.photometric_loss(frame, on_cpu(photograph), weight, given_mask, noise=noise)
    assert loss.total == pytest.approx(total, abs=2e-6)
    assert loss.l1 == pytest.approx(l1, abs=2e-6)
    assert loss.ssim == pytest.approx(ssim, abs=5e-6)
    error = np.linalg.norm(frame.grad_color.numpy() - gradient)
    assert error <= 2e-5 * np.linalg.norm(gradient) + 1e-12


def on_cpu(values: np.ndarray) -> wp.array:
    return wp.array(values, dtype=wp.uint8 if values.dtype == np.uint8 else wp.float32, device="cpu")


def test_a_photograph_of_floats_is_as_good_as_one_of_bytes():
    x, photograph = images(50, 37)
    rasterizer = Rasterizer(threads=1)
    frame = frame_showing(rasterizer, x)
    of_bytes = rasterizer.photometric_loss(frame, on_cpu(photograph))
    gradient = frame.grad_color.numpy().copy()
    of_floats = rasterizer.photometric_loss(frame, on_cpu(photograph.astype(np.float32) / np.float32(255)))
    assert of_floats.total == pytest.approx(of_bytes.total, abs=1e-7)
    np.testing.assert_allclose(frame.grad_color.numpy(), gradient, atol=1e-7)


def test_a_perfect_image_has_no_loss_and_no_gradient():
    _, photograph = images(30, 20)
    rasterizer = Rasterizer(threads=2)
    target = photograph.astype(np.float32) / np.float32(255)
    frame = frame_showing(rasterizer, target)
    loss = rasterizer.photometric_loss(frame, on_cpu(target))
    assert loss.l1 == 0.0
    assert loss.ssim == pytest.approx(1.0, abs=1e-6)
    slope_of_l1 = 0.8 / target.size
    assert np.abs(frame.grad_color.numpy()).max() < 1e-3 * slope_of_l1


def test_what_the_mask_leaves_out_counts_as_nothing():
    x, photograph = images(40, 30)
    mask = np.ones((30, 40), np.float32)
    mask[:, 25:] = 0.0
    rasterizer = Rasterizer(threads=2)
    results = []
    for disturbed in (False, True):
        image = x.copy()
        if disturbed:
            image[:, 25:] = np.random.default_rng(3).uniform(size=(30, 15, 3))
        frame = frame_showing(rasterizer, image)
        loss = rasterizer.photometric_loss(frame, on_cpu(photograph), mask=Mask.of(mask))
        results.append(((loss.l1, loss.ssim), frame.grad_color.numpy().copy()))
    assert results[0][0] == results[1][0]
    np.testing.assert_array_equal(results[0][1], results[1][1])
    assert not results[0][1][:, 25:].any()


def test_an_empty_mask_has_no_loss_and_no_gradient():
    x, photograph = images(20, 20)
    rasterizer = Rasterizer(threads=1)
    frame = frame_showing(rasterizer, x)
    loss = rasterizer.photometric_loss(frame, on_cpu(photograph), mask=Mask.of(np.zeros((20, 20), np.float32)))
    assert loss.total == 0.0
    assert not frame.grad_color.numpy().any()


def test_images_of_different_sizes_may_alternate():
    rasterizer = Rasterizer(threads=2)
    for width, height in [(40, 33), (96, 64), (7, 5), (40, 33), (96, 64)]:
        x, photograph = images(width, height)
        frame = frame_showing(rasterizer, x)
        loss = rasterizer.photometric_loss(frame, on_cpu(photograph))
        assert loss.total == pytest.approx(expected_loss(x, photograph / 255.0, 0.2, None)[0], abs=2e-6)


def test_a_photograph_of_another_size_is_refused():
    rasterizer = Rasterizer(threads=1)
    frame = frame_showing(rasterizer, images(20, 20)[0])
    with pytest.raises(ValueError, match="target has shape"):
        rasterizer.photometric_loss(frame, on_cpu(images(21, 20)[1]))


def test_a_frame_that_was_written_over_is_refused():
    rasterizer = Rasterizer(threads=1)
    x, photograph = images(20, 20)
    frame = frame_showing(rasterizer, x)
    frame_showing(rasterizer, x)
    with pytest.raises(ValueError, match="latest"):
        rasterizer.photometric_loss(frame, on_cpu(photograph))
