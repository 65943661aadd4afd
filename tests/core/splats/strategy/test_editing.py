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


def test_halves_keep_mean_and_variance_along_the_longest_axis():
    old = gaussians(20)
    old.log_scales[:] = np.log(np.random.default_rng(1).uniform(0.1, 1.0, (20, 3)))
    first, second = divide(old)
    rows, longest = np.arange(20), old.log_scales.argmax(axis=1)
    scale = np.exp(old.log_scales[rows, longest])
    direction = rotate(old.quaternions, np.eye(3)[longest])
    offset = first.means - old.means
    np.testing.assert_allclose(second.means - old.means, -offset, atol=1e-6)
    np.testing.assert_allclose(np.abs(np.sum(offset * direction, axis=1)), np.linalg.norm(offset, axis=1), rtol=1e-4)
    for half in (first, second):
        variance = np.exp(2.0 * half.log_scales[rows, longest]) + np.sum(offset**2, axis=1)
        np.testing.assert_allclose(variance, scale**2, rtol=1e-3)


def test_halves_cover_no_more_than_nine_tenths_of_the_area_of_the_whole_from_any_side():
    old = gaussians(20)
    old.log_scales[:] = np.log(np.random.default_rng(1).uniform(0.1, 1.0, (20, 3)))
    rows, longest = np.arange(20), old.log_scales.argmax(axis=1)
    for half in divide(old):
        factors = np.exp(half.log_scales - old.log_scales)
        along = factors[rows, longest]
        across = np.delete(factors.ravel(), rows * 3 + longest).reshape(-1, 2)
        # Seen from the side a half has the longest axis and one other, seen from an end the two others.
        assert (2.0 * along[:, None] * across < 0.9).all()
        assert (2.0 * across.prod(axis=1) < 0.9).all()
