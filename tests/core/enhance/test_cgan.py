"""The enhancer that predicts its network: one for all views, within the budget, with and without a fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.spaces import delta_e_2000, image_to_tensor
from cvdgs.core.enhance import CganEnhancer, SceneNetworkEnhancer, make_enhancer
from cvdgs.core.enhance.gan.networks import Generator
from cvdgs.core.enhance.gan.prediction import predict_corrected, predict_networks
from cvdgs.core.enhance.gan.weights import save_generator
from cvdgs.core.enhance.scene.objective import Objective
from cvdgs.core.errors import InputError

from . import textiles
from .gan.networks import random_generator


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "weights.safetensors"
    save_generator(random_generator(), path)
    return path


@pytest.mark.parametrize(("severity", "strength"), [(0.0, 1.0), (1.0, 0.0), (0.0, 0.0)])
def test_severity_zero_and_strength_zero_are_the_identity(weights, severity, strength):
    enhancer = CganEnhancer("deutan", severity, strength=strength, weights=weights)
    image = noise(20, 30)
    assert enhancer.is_identity
    assert np.array_equal(enhancer(image), image.astype(np.float32) / np.float32(255.0))


@pytest.mark.parametrize("fit_steps", [0, 3])
def test_an_image_changes_by_no_more_than_the_budget(weights, fit_steps):
    image = textiles.tartan()
    enhancer = CganEnhancer("deutan", 1.0, weights=weights, budget=1.5, fit_steps=fit_steps)
    enhancer.fit([image])
    result = enhancer(image)
    assert result.shape == image.shape
    assert result.dtype == np.float32
    assert 0.0 <= result.min() <= result.max() <= 1.0
    changed = float(delta_e_2000(image_to_tensor(image), image_to_tensor(result)).mean())
    assert 0.3 < changed < 1.7


@pytest.mark.parametrize("budget", [None, 3.0, 1.5])
def test_a_fit_improves_on_the_prediction_or_leaves_it(weights, budget, monkeypatch):
    monkeypatch.setattr("cvdgs.core.enhance.cgan.predict_corrected", predict_networks)
    image, scores = textiles.tartan(), []
    objective = Objective(image_to_tensor(image), Observer("deutan", 1.0))
    for fit_steps in (0, 25):
        enhancer = CganEnhancer("deutan", 1.0, weights=weights, budget=budget, fit_steps=fit_steps)
        enhancer.fit([image])
        scores.append(float(objective(image_to_tensor(enhancer(image)), 0.0)))
    assert scores[1] <= scores[0] + 0.01
    assert budget or scores[1] < 0.9 * scores[0]


def test_without_a_fit_the_prediction_is_corrected(weights, monkeypatch):
    image, changes = textiles.tartan(size=48), []
    for predict in (predict_corrected, predict_networks):
        monkeypatch.setattr("cvdgs.core.enhance.cgan.predict_corrected", predict)
        enhancer = CganEnhancer("deutan", 1.0, weights=weights, fit_steps=0)
        enhancer.fit([image])
        changes.append(enhancer(image))
    assert np.abs(changes[0] - changes[1]).mean() > 0.01


def test_what_it_made_is_a_scene_network_that_can_be_used_again(weights, tmp_path):
    image = textiles.tartan(size=48)
    enhancer = CganEnhancer("deutan", 1.0, weights=weights, fit_steps=0)
    enhancer.fit([image])
    enhancer.save(tmp_path / "layer.safetensors")
    again = make_enhancer(str(tmp_path / "layer.safetensors"), "deutan", 1.0)
    assert isinstance(again, SceneNetworkEnhancer)
    assert np.array_equal(again(image), enhancer(image))


def test_one_thread_and_two_predict_the_same_network(weights):
    threads, networks = torch.get_num_threads(), []
    try:
        for number in (1, 2):
            torch.set_num_threads(number)
            enhancer = CganEnhancer("deutan", 1.0, weights=weights, fit_steps=0)
            enhancer.fit([textiles.tartan(size=320)])
            networks.append(enhancer.fitted)
    finally:
        torch.set_num_threads(threads)
    assert networks[0].budget == networks[1].budget
    for one, other in zip(*(fitted.network.parameters() for fitted in networks), strict=True):
        assert torch.equal(one, other)


def test_what_is_fitted_keeps_no_generator_and_can_be_fitted_again(weights):
    enhancer = CganEnhancer("deutan", 1.0, weights=weights, fit_steps=0)
    image, generators = textiles.tartan(size=48), []
    for _ in range(2):
        enhancer.fit([image])
        generators.append(sum(isinstance(one, Generator) for one in vars(enhancer).values()))
    assert generators == [0, 0]
    again = CganEnhancer("deutan", 1.0, weights=weights, fit_steps=0)
    again.fit([image])
    assert np.array_equal(again(image), enhancer(image))


def test_it_has_to_be_fitted_first(weights):
    with pytest.raises(RuntimeError, match="fit"):
        CganEnhancer("deutan", 1.0, weights=weights)(noise(8, 8))


def test_a_number_of_steps_below_zero_is_refused(weights):
    with pytest.raises(InputError, match="--fit"):
        CganEnhancer("deutan", 1.0, weights=weights, fit_steps=-1)


def test_a_file_of_weights_is_an_enhancer(weights):
    assert isinstance(make_enhancer(str(weights), "deutan", 1.0), CganEnhancer)


def test_missing_weights_are_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.safetensors.*cannot be read"):
        make_enhancer(str(tmp_path / "nowhere.safetensors"), "deutan", 1.0)
