"""What steers the networks is the observer and the scene, not how the scene was photographed."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.color.simulation import Observer
from cvdgs.core.enhance.gan.conditioning import (
    OBSERVER_FEATURES,
    PALETTE_BINS,
    observer_features,
    palette,
)

MIXED = [
    Observer("deutan", 0.7, "brettel"),
    Observer("tritan", 1.0),
    Observer("protan", 0.35, "vienot"),
    Observer("achromat", 0.5),
    Observer("deutan", 0.0),
]


def test_observers_differ_in_their_features():
    features = {tuple(observer_features(observer).tolist()) for observer in MIXED}
    assert len(features) == len(MIXED)
    assert all(len(feature) == OBSERVER_FEATURES for feature in features)


@given(st.permutations(range(4)))
def test_the_order_of_the_views_does_not_matter(order):
    views = [np.random.default_rng(seed).integers(0, 256, (8, 9, 3), np.uint8) for seed in range(4)]
    assert torch.allclose(palette([views[i] for i in order]), palette(views), atol=1e-6)


def test_a_palettes_histogram_is_a_distribution():
    shares = palette([np.random.default_rng(0).random((20, 20, 3))])[: PALETTE_BINS**3] ** 2
    assert abs(float(shares.sum()) - 1.0) < 1e-5


def test_a_palette_tells_whether_reds_are_the_yellower_colours():
    warm = np.array([[[200, 90, 20], [60, 140, 160]]], np.uint8)  # orange and teal
    cold = np.array([[[190, 60, 160], [110, 160, 20]]], np.uint8)  # magenta and lime
    assert palette([warm])[-1] > 0.9
    assert palette([cold])[-1] < -0.9


def test_a_slightly_different_light_changes_the_palette_slightly():
    image = np.random.default_rng(0).integers(0, 250, (40, 40, 3), np.uint8)
    assert (palette([image]) - palette([image + 2])).abs().max() < 0.05


def test_uncovered_pixels_do_not_count():
    red, green = np.full((6, 6, 3), (200, 0, 0), np.uint8), np.full((6, 6, 3), (0, 200, 0), np.uint8)
    alpha = np.zeros((6, 12), np.uint8)
    alpha[:, :6] = 255
    assert torch.equal(palette([np.concatenate([red, green], 1)], [alpha]), palette([red]))


def test_a_scene_without_a_visible_pixel_has_an_empty_palette():
    assert float(palette([np.zeros((4, 4, 3), np.uint8)], [np.zeros((4, 4), np.uint8)]).abs().sum()) == 0.0
