"""The multi-view loss pulls a rendering towards what the other views agree on, as its formula says."""

import numpy as np
import pytest
import warp as wp

from cvdgs.core.consistency import Consensus
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.multi_view_loss import MultiViewLoss
from cvdgs.core.splats.raster import ParameterSet, RasterCamera, Rasterizer

HEIGHT, WIDTH = 24, 32
SOFTNESS = 2.0 / 255.0


@pytest.fixture
def frame():
    rng = np.random.default_rng(0)
    scene = Gaussians(
        rng.uniform([-1, -1, 3], [1, 1, 4], (60, 3)).astype(np.float32),
        np.full((60, 3), np.log(0.3), np.float32),
        rng.standard_normal((60, 4)).astype(np.float32),
        np.full(60, 2.0, np.float32),
        ((rng.uniform(0, 1, (60, 1, 3)) - 0.5) / SH_C0).astype(np.float32),
    )
    rasterizer = Rasterizer("cpu", 1)
    camera = RasterCamera(WIDTH, HEIGHT, 30.0, 30.0, WIDTH / 2, HEIGHT / 2, np.eye(4))
    return rasterizer.render(ParameterSet.from_gaussians(scene), camera)


def consensus(seed: int = 1) -> Consensus:
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0, 1, (HEIGHT, WIDTH)).astype(np.float32)
    weights[:8] = 0.0
    return Consensus(rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8), weights)


def loss(color: np.ndarray, said: Consensus) -> float:
    """L_mv by its formula."""
    apart = color.astype(np.float64) - said.colors / 255.0
    penalty = np.sqrt(apart**2 + SOFTNESS**2).sum(axis=2)
    return float((said.weights * penalty).sum() / (3.0 * said.weights.sum()))


def test_the_gradient_is_that_of_the_formula_and_is_added(frame):
    said, strength = consensus(), 0.7
    color = frame.color.numpy().astype(np.float64)
    frame.grad_color.fill_(0.25)
    MultiViewLoss(said, strength, wp.get_device("cpu")).add_gradient(frame)
    gradient = frame.grad_color.numpy() - 0.25
    step = 1e-6
    for row, column, channel in ((3, 3, 0), (10, 20, 1), (20, 5, 2), (23, 31, 0)):
        moved = [color.copy(), color.copy()]
        moved[0][row, column, channel] += step
        moved[1][row, column, channel] -= step
        expected = strength * (loss(moved[0], said) - loss(moved[1], said)) / (2 * step)
        assert gradient[row, column, channel] == pytest.approx(expected, rel=1e-3, abs=1e-8)


def test_where_nobody_has_a_say_nothing_is_added(frame):
    said = consensus()
    frame.grad_color.fill_(0.25)
    MultiViewLoss(said, 1.0, wp.get_device("cpu")).add_gradient(frame)
    assert (frame.grad_color.numpy()[:8] == 0.25).all()
    MultiViewLoss(Consensus(said.colors, np.zeros_like(said.weights)), 1.0, wp.get_device("cpu")).add_gradient(frame)
    assert np.isfinite(frame.grad_color.numpy()).all()
