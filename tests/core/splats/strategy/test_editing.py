"""Dividing Gaussians keeps their moments; Morton order is a permutation that keeps neighbours together."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.splats.strategy.editing import divide, in_morton_order, morton_order, rotate
from cvdgs.core.splats.strategy.model import Refinement

from ..sets import gaussians


@given(st.integers(0, 300), st.floats(1e-6, 1e6), st.integers(0, 2**31))
@settings(max_examples=30, deadline=None)
def test_it_is_a_permutation_whatever_the_positions(count, scale, seed):
    means = np.random.default_rng(seed).normal(0, scale, (count, 3)).astype(np.float32)
    means[: count // 10] = np.nan
    assert sorted(morton_order(means)) == list(range(count))


def test_neighbours_in_the_order_are_neighbours_in_space_even_with_one_far_away():
    means = np.random.default_rng(0).uniform(-1, 1, (5000, 3)).astype(np.float32)
    means[17] = 1e6
    steps = np.linalg.norm(np.diff(means[morton_order(means)], axis=0), axis=1)
    assert np.median(steps) < 0.15 * np.median(np.linalg.norm(np.diff(means, axis=0), axis=1))


def test_the_cells_of_a_grid_come_in_the_order_of_the_curve():
    x, y, z = np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")
    means = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    np.testing.assert_array_equal(means[morton_order(means)] @ [1, 2, 4], np.arange(8))


def test_source_and_fresh_move_with_their_gaussians():
    old = gaussians(40)
    source = np.arange(40)[::-1].copy()
    shuffled = type(old)(**{name: value[source] for name, value in vars(old).items()})
    ordered = in_morton_order(Refinement(shuffled, source, source % 3 == 0))
    np.testing.assert_array_equal(ordered.gaussians.means, old.means[ordered.source])
    np.testing.assert_array_equal(ordered.fresh, ordered.source % 3 == 0)


def test_halves_have_the_mean_and_the_variance_of_the_whole():
    old = gaussians(20)
    old.log_scales[:] = np.log(np.random.default_rng(1).uniform(0.1, 1.0, (20, 3)))
    first, second = divide(old)

    def covariance(g):
        axes = rotate(np.repeat(g.quaternions, 3, axis=0), np.tile(np.eye(3), (len(g), 1))).reshape(-1, 3, 3)
        return np.einsum("nki,nk,nkj->nij", axes, np.exp(2.0 * g.log_scales), axes)

    offset = first.means - old.means
    np.testing.assert_allclose(second.means - old.means, -offset, atol=1e-6)
    together = covariance(first) + offset[:, :, None] * offset[:, None, :]
    np.testing.assert_allclose(together, covariance(old), rtol=1e-3, atol=1e-5)
