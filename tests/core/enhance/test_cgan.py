"""The trained enhancer gives one colour one result in all views of a scene, and does what it was asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.enhance import CganEnhancer, make_enhancer
from cvdgs.core.enhance.gan.weights import save_generator
from cvdgs.core.errors import InputError

from .gan.networks import SMALL, random_generator


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


@pytest.fixture(scope="module", params=["none", "instance", "scene"])
def weights(request, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("weights") / f"{request.param}.safetensors"
    save_generator(random_generator(replace(SMALL, normalisation=request.param)), path)
    return path


@pytest.mark.parametrize(("severity", "strength"), [(0.0, 1.0), (1.0, 0.0), (0.0, 0.0)])
def test_severity_zero_and_strength_zero_are_the_identity(weights, severity, strength):
    enhancer = CganEnhancer("deutan", severity, strength=strength, weights=weights)
    image = noise(20, 30)
    assert enhancer.is_identity
    assert np.array_equal(enhancer(image), image.astype(np.float32) / np.float32(255.0))


def test_an_image_changes_and_keeps_its_shape_and_range(weights):
    enhancer, image = CganEnhancer("deutan", 1.0, weights=weights), noise(37, 51)
    enhancer.fit([image])
    result = enhancer(image)
    assert result.shape == image.shape
    assert result.dtype == np.float32
    assert 0.0 <= result.min() <= result.max() <= 1.0
    assert np.abs(result - image / 255.0).mean() > 0.01


def test_what_a_view_becomes_hardly_depends_on_the_order_of_the_views(weights):
    views = [noise(24, 24, seed) for seed in range(3)]
    results = []
    for order in (views, views[::-1]):
        enhancer = CganEnhancer("protan", 0.7, weights=weights)
        enhancer.fit(order)
        results.append(enhancer(views[0]))
    # The LUT is fitted to pixels that are drawn from the views in their order.
    assert np.abs(results[0] - results[1]).mean() < 0.2 * np.abs(results[0] - views[0] / 255.0).mean()


def test_uncovered_pixels_do_not_steer(weights):
    if weights.stem == "scene":
        pytest.skip("statistics are of whole images")
    view, alpha = noise(24, 24), np.zeros((24, 24), np.uint8)
    alpha[:, :12] = 255
    other = view.copy()
    other[:, 12:] = 255
    results = []
    for image in (view, other):
        enhancer = CganEnhancer("deutan", 1.0, weights=weights)
        enhancer.fit([image], alphas=[alpha])
        results.append(enhancer(view))
    assert np.array_equal(*results)


def test_types_and_severities_are_enhanced_differently(weights):
    image = noise(24, 24)
    results = []
    for observer in (("deutan", 1.0), ("deutan", 0.5), ("tritan", 1.0)):
        enhancer = CganEnhancer(*observer, weights=weights)
        enhancer.fit([image])
        results.append(enhancer(image))
    assert min(np.abs(a - b).mean() for a, b in zip(results, [*results[1:], results[0]], strict=True)) > 1e-3


def test_it_has_to_be_fitted_first(weights):
    with pytest.raises(RuntimeError, match="fit"):
        CganEnhancer("deutan", 1.0, weights=weights)(noise(8, 8))


def test_a_file_of_weights_is_an_enhancer(weights):
    enhancer = make_enhancer(str(weights), "deutan", 1.0)
    assert isinstance(enhancer, CganEnhancer)


def test_missing_weights_are_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.safetensors.*cannot be read"):
        make_enhancer(str(tmp_path / "nowhere.safetensors"), "deutan", 1.0)
