"""Neighbouring views say what a view should show, and gloss in the photographs is told from drift of the enhancer."""

from __future__ import annotations

import numpy as np
import pytest

from cvdgs.core.consistency import AgreementSettings, CorrespondenceSettings, SceneAgreement, SceneCorrespondences

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
    consensus = SceneAgreement(matched(rendered, stride), photographs).consensus(drift(photographs, {2: 40}))
    said = consensus[2]
    known = said.weights > 0
    assert known.mean() > 0.7
    assert np.abs(said.colors[known].astype(int) - photographs[2][known]).mean() < 2.0
    assert said.weights[known].mean() > 0.95 * 255


def test_one_view_that_drifted_far_does_not_pull_its_neighbours(rendered):
    photographs = as_bytes(rendered[0])
    consensus = SceneAgreement(matched(rendered), photographs).consensus(drift(photographs, {2: 90}))
    known = consensus[3].weights > 0
    assert np.abs(consensus[3].colors[known].astype(int) - photographs[3][known]).mean() < 3.0


def test_views_that_agree_keep_their_texture(rendered):
    rng = np.random.default_rng(0)
    photographs = as_bytes(rendered[0])
    noisy = {i: np.clip(x + rng.integers(-20, 21, x.shape), 0, 255).astype(np.uint8) for i, x in photographs.items()}
    consensus = SceneAgreement(matched(rendered), photographs).consensus(noisy)
    apart = [np.abs(consensus[i].colors.astype(int) - image).mean() for i, image in noisy.items()]
    assert max(apart) < 3.0  # of the noise's own 10


def test_where_no_other_view_sees_a_pixel_it_keeps_its_colour_without_weight(rendered):
    photographs = as_bytes(rendered[0])
    images, depths, alphas, _ = rendered
    alphas = [alpha.copy() for alpha in alphas]
    alphas[2][:36] = 0.0
    correspondences = matched((images, depths, alphas, None))
    said = SceneAgreement(correspondences, photographs).consensus(drift(photographs, {2: 40}))[2]
    np.testing.assert_array_equal(said.colors[:30], drift(photographs, {2: 40})[2][:30])
    assert (said.weights[:30] == 0).all()
    assert said.weights[40:].max() > 0.9 * 255


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


def test_gloss_has_no_say_in_the_consensus(rendered):
    images, _, _, seen = rendered
    glossy = as_bytes([image - 0.2 + 0.12 * i * (seen[i] == 1)[..., None] for i, image in enumerate(images)])
    said = SceneAgreement(matched(rendered), glossy).consensus(glossy)[3]
    known = said.weights > 0
    assert said.weights[known & (seen[3] == 1)].mean() < 0.6 * 255
    assert said.weights[known & (seen[3] == 0)].mean() > 0.9 * 255


def test_views_that_share_nothing_are_trusted_as_they_are(rendered):
    images, depths, alphas, _ = rendered
    unseen = matched((images, depths, [np.zeros_like(alpha) for alpha in alphas], None))
    agreement = SceneAgreement(unseen, as_bytes(images))
    assert all((weights == 255).all() for weights in agreement.weights.values())
    assert all((said.weights == 0).all() for said in agreement.consensus(as_bytes(images)).values())
