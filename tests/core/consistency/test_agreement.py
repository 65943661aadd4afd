"""Neighbouring views say what a view should show, and gloss in the photographs is told from drift of the enhancer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.consistency import (
    AgreementSettings,
    Consensus,
    CorrespondenceSettings,
    SceneAgreement,
    SceneCorrespondences,
)

from . import scenes

WALL = scenes.Plane((0.0, 0.1, 1.0), 1.0)
STRIPE = scenes.Plane((0.0, 0.0, 1.0), -0.3, half_width=0.4, tint=0.1)
VIEWS = [scenes.camera_at((x, -0.3, -4.0)) for x in (-0.9, -0.6, -0.3, 0.0, 0.3, 0.6)]


def as_bytes(images: list[np.ndarray]) -> dict[int, np.ndarray]:
    return {i: np.clip(np.round(255 * image), 0, 255).astype(np.uint8) for i, image in enumerate(images)}


@pytest.fixture(scope="module")
def rendered():
    return scenes.render_all(VIEWS, [WALL, STRIPE])


def matched(rendered, stride: int = 1) -> SceneCorrespondences:
    _, depths, alphas, _ = rendered
    return SceneCorrespondences(VIEWS, lambda i: (depths[i], alphas[i]), CorrespondenceSettings(stride=stride))


def drift(images: dict[int, np.ndarray], amounts: dict[int, int]) -> dict[int, np.ndarray]:
    """Images brightened by so many levels."""
    return {i: np.clip(image.astype(int) + amounts.get(i, 0), 0, 255).astype(np.uint8) for i, image in images.items()}


@pytest.mark.parametrize("stride", [1, 3])
def test_the_others_say_what_a_drifted_view_should_have_shown(rendered, stride):
    photographs = as_bytes(rendered[0])
    drifted = drift(photographs, {2: 40})
    said = SceneAgreement(matched(rendered, stride), photographs).consensus(drifted)[2]
    known = said.known(*photographs[2].shape[:2])
    assert known.mean() > 0.7
    assert np.abs(said.colors(drifted[2])[known].astype(int) - photographs[2][known]).mean() < 2.0


def test_one_view_that_drifted_far_does_not_pull_its_neighbours(rendered):
    photographs = as_bytes(rendered[0])
    said = SceneAgreement(matched(rendered), photographs).consensus(drift(photographs, {2: 90}))[3]
    known = said.known(*photographs[3].shape[:2])
    assert np.abs(said.colors(photographs[3])[known].astype(int) - photographs[3][known]).mean() < 3.0


def test_views_that_agree_keep_their_texture(rendered):
    rng = np.random.default_rng(0)
    photographs = as_bytes(rendered[0])
    noisy = {i: np.clip(x + rng.integers(-20, 21, x.shape), 0, 255).astype(np.uint8) for i, x in photographs.items()}
    consensus = SceneAgreement(matched(rendered), photographs).consensus(noisy)
    apart = [np.abs(consensus[i].colors(image).astype(int) - image).mean() for i, image in noisy.items()]
    assert max(apart) < 3.0  # of the noise's own 10


def test_where_no_other_view_sees_a_pixel_it_keeps_its_colour_without_weight(rendered):
    photographs = as_bytes(rendered[0])
    images, depths, alphas, _ = rendered
    alphas = [alpha.copy() for alpha in alphas]
    alphas[2][:36] = 0.0
    correspondences = matched((images, depths, alphas, None))
    drifted = drift(photographs, {2: 40})
    said = SceneAgreement(correspondences, photographs).consensus(drifted)[2]
    np.testing.assert_array_equal(said.colors(drifted[2])[:30], drifted[2][:30])
    known = said.known(*drifted[2].shape[:2])
    assert not known[:30].any()
    assert known[40:].any()


@pytest.mark.parametrize("stride", [1, 3])
def test_what_varies_with_the_view_in_the_photographs_counts_less(rendered, stride):
    images, _, _, seen = rendered
    glossy = [
        image + 0.12 * i * (number == 1)[..., None] for i, (image, number) in enumerate(zip(images, seen, strict=True))
    ]
    agreement = SceneAgreement(matched(rendered, stride), as_bytes([image - 0.2 for image in glossy]))
    inside = {i: seen[i] == 1 for i in range(len(VIEWS))}
    stripe = np.mean([agreement.weights[i][inside[i]].mean() for i in inside]) / 255
    wall = np.mean([agreement.weights[i][~inside[i]].mean() for i in inside]) / 255
    assert wall > 0.95
    assert stripe < 0.6
    assert all(weights.min() >= AgreementSettings().least_weight * 255 for weights in agreement.weights.values())


def test_photographs_of_different_exposure_are_still_trusted(rendered):
    exposed = drift(as_bytes(rendered[0]), {0: 6, 2: -6, 3: 8, 5: -4})
    agreement = SceneAgreement(matched(rendered), exposed)
    assert np.mean([weights.mean() for weights in agreement.weights.values()]) > 0.85 * 255


def test_views_that_share_nothing_are_trusted_as_they_are(rendered):
    images, depths, alphas, _ = rendered
    unseen = matched((images, depths, [np.zeros_like(alpha) for alpha in alphas], None))
    agreement = SceneAgreement(unseen, as_bytes(images))
    assert all((weights == 255).all() for weights in agreement.weights.values())
    assert not any(said.known(*images[0].shape[:2]).any() for said in agreement.consensus(as_bytes(images)).values())


@given(height=st.integers(1, 9), width=st.integers(1, 9), seed=st.integers(0, 99))
def test_a_consensus_shifts_the_pixels_of_a_square_together_and_clips(height, width, seed):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (height, width, 3), np.uint8)
    shifts, known = rng.uniform(-300, 300, (height, width, 3)), rng.random((height, width)) < 0.5
    said = Consensus.of(shifts, known)
    first = [np.arange(side) // Consensus.CELL * Consensus.CELL for side in (height, width)]
    square = np.ix_(*first)
    np.testing.assert_array_equal(said.known(height, width), known[square])
    levels = np.clip(np.round(shifts[square]), -127, 127) * known[square][..., None]
    np.testing.assert_array_equal(said.colors(image), np.clip(image + levels, 0, 255).astype(np.uint8))
