"""The similarity between two sets of points: known ones are found again, and what tells none is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cvdgs.core.errors import InputError
from cvdgs.core.splats.similarity import fit_similarity


def points(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((count, 3))


def moved(sources: np.ndarray, scale: float, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return scale * Rotation.random(random_state=seed).apply(sources) + random.uniform(-5.0, 5.0, 3)


def applied(matrix: np.ndarray, sources: np.ndarray) -> np.ndarray:
    return sources @ matrix[:3, :3].T + matrix[:3, 3]


@given(count=st.integers(3, 30), scale=st.floats(1e-2, 1e2), seed=st.integers(0, 10_000))
def test_a_known_similarity_is_found_again(count, scale, seed):
    sources = points(count, seed)
    targets = moved(sources, scale, seed)
    found = fit_similarity(sources, targets)
    assert found.scale == pytest.approx(scale, rel=1e-6)
    assert np.linalg.det(found.matrix[:3, :3]) > 0.0, "no mirror"
    np.testing.assert_allclose(applied(found.matrix, sources), targets, atol=1e-6 * max(scale, 1.0))
    assert found.error < 1e-6 * max(scale, 1.0)


@given(seed=st.integers(0, 10_000))
def test_without_scale_it_agrees_with_scipys_rotation(seed):
    sources = points(8, seed)
    targets = moved(sources, 1.0, seed) + 0.1 * points(8, seed + 1)
    found = fit_similarity(sources, targets, with_scale=False)
    expected, _ = Rotation.align_vectors(targets - targets.mean(0), sources - sources.mean(0))
    np.testing.assert_allclose(found.matrix[:3, :3], expected.as_matrix(), atol=1e-6)
    assert found.scale == 1.0


def test_no_similarity_nearby_is_closer():
    sources = points(6)
    targets = moved(sources, 2.0, 1) + 0.2 * points(6, 2)
    found = fit_similarity(sources, targets)
    random = np.random.default_rng(3)
    for _ in range(50):
        turn = np.eye(4)
        turn[:3, :3] = (1.0 + random.normal(0, 0.01)) * Rotation.from_rotvec(random.normal(0, 0.01, 3)).as_matrix()
        turn[:3, 3] = random.normal(0, 0.01, 3)
        other = applied(turn @ found.matrix, sources) - targets
        assert np.sqrt(np.mean((other**2).sum(axis=1))) >= found.error


def test_a_mirrored_scene_is_turned_and_the_rest_is_told():
    sources = points(10)
    found = fit_similarity(sources, sources * [1.0, 1.0, -1.0])
    assert np.linalg.det(found.matrix[:3, :3]) > 0.0
    assert found.error > 0.1


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (np.zeros((0, 3)), "0 pairs of points - give at least 3"),
        (points(2), "2 pairs"),
        (np.outer(np.arange(4.0), [1.0, 2.0, 3.0]), "on one line"),
        (np.ones((5, 3)), "on one line"),
        (np.full((3, 3), np.nan), "not finite"),
    ],
)
def test_what_tells_no_similarity_is_refused(sources, message):
    with pytest.raises(InputError, match=message):
        fit_similarity(sources, points(len(sources)), where="marks")
