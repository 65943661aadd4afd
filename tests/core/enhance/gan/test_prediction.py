"""Networks are predicted for a whole scene, from what its views show and for whom, one in each direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from cvdgs.core.color.simulation import Observer
from cvdgs.core.enhance.gan.conditioning import CONDITION_FEATURES, condition, palette
from cvdgs.core.enhance.gan.networks import DIRECTIONS, STRIDE, Generator
from cvdgs.core.enhance.gan.prediction import SIDE, predict_corrected, predict_networks, start_table
from cvdgs.core.enhance.gan.trial import Trial
from cvdgs.core.enhance.scene.network import SceneNetwork
from cvdgs.core.enhance.scene.views import reduced
from cvdgs.core.errors import InputError

from ..textiles import tartan
from .networks import random_generator

DEUTAN = Observer("deutan", 1.0)


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def values(networks: Sequence[SceneNetwork]) -> torch.Tensor:
    return torch.cat([value.flatten() for network in networks for value in network.state_dict().values()])


def test_an_untrained_generator_predicts_the_two_directions_that_the_fit_tries():
    torch.manual_seed(0)
    expected = start_table(DEUTAN).flatten()
    networks = predict_networks(Generator(), [noise(40, 50)], DEUTAN, 2.0)
    for network, direction in zip(networks, DIRECTIONS, strict=True):
        found = network.table.detach().flatten()
        assert float(torch.cosine_similarity(found, direction * expected, 0)) > 0.99


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 70), st.integers(1, 70))
def test_views_of_any_size_give_a_network(height, width):
    networks = predict_networks(random_generator(), [noise(height, width)], DEUTAN, 2.0)
    assert torch.isfinite(values(networks)).all()


def test_the_order_of_the_views_does_not_matter():
    views = [noise(30, 40, 1), noise(48, 32, 2), noise(33, 33, 3)]
    one, other = (values(predict_networks(random_generator(), v, DEUTAN, 2.0)) for v in (views, views[::-1]))
    assert torch.allclose(one, other, atol=1e-4)


@pytest.mark.parametrize(
    ("observer", "budget"), [(Observer("protan", 1.0), 2.0), (Observer("deutan", 0.5), 2.0), (DEUTAN, 4.0)]
)
def test_observer_and_budget_matter(observer, budget):
    view = noise(40, 40)
    usual = values(predict_networks(random_generator(), [view], DEUTAN, 2.0))
    assert (usual - values(predict_networks(random_generator(), [view], observer, budget))).abs().max() > 1e-5


def test_what_is_not_covered_does_not_steer():
    alpha = np.zeros((STRIDE * 2, STRIDE * 2), np.uint8)
    alpha[:, :STRIDE] = 255
    view = noise(*alpha.shape)
    other = view.copy()
    other[:, STRIDE + 8 :] = 255
    one, two = (values(predict_networks(random_generator(), [v], DEUTAN, 2.0, [alpha])) for v in (view, other))
    assert torch.equal(one, two)


@pytest.mark.parametrize("predict", [predict_networks, predict_corrected])
def test_a_scene_that_cannot_be_seen_is_refused(predict):
    with pytest.raises(InputError, match="no view has a visible pixel"):
        predict(random_generator(), [noise(8, 8)], DEUTAN, 2.0, [np.zeros((8, 8), np.uint8)])


@settings(max_examples=6, deadline=None)
@given(st.integers(1, 70), st.integers(1, 70))
def test_views_of_any_size_can_be_corrected(height, width):
    assert torch.isfinite(values(predict_corrected(random_generator(), [noise(height, width)], DEUTAN, 2.0))).all()


def test_a_correction_does_not_depend_on_torchs_random_numbers():
    generator, view, found = random_generator(), tartan(size=48), []
    for seed in (0, 1):
        torch.manual_seed(seed)
        found.append(values(predict_corrected(generator, [view], DEUTAN, 2.0)))
    assert torch.equal(*found)


def judged(generator: Generator, view: np.ndarray) -> list[tuple[float, float]]:
    """The objective of each prediction, and of what corrections make of it."""
    trial = Trial([reduced(view, None, SIDE)], DEUTAN, 2.0, generator=torch.Generator().manual_seed(0))
    predicted, corrected = (
        [network.state_dict() for network in predict(generator, [view], DEUTAN, 2.0)]
        for predict in (predict_networks, predict_corrected)
    )
    return [(trial.draft(a).loss, float(trial.loss(b)[0])) for a, b in zip(predicted, corrected, strict=True)]


@pytest.mark.parametrize("view", [tartan(size=64), noise(40, 50)], ids=["tartan", "noise"])
def test_a_correction_makes_a_prediction_better(view):
    generator = random_generator()
    generator.rates.fill_(-9.0)
    for before, after in judged(generator, view):
        assert after < before - 1e-3


def test_a_correction_that_goes_too_far_is_left_out():
    generator = random_generator()
    generator.rates.fill_(2.0)
    for before, after in judged(generator, tartan(size=64)):
        assert after == pytest.approx(before)


def test_a_correction_has_its_size_whatever_the_gradients():
    generator, (state, gradient) = (
        random_generator(),
        ({name: torch.rand_like(value) for name, value in SceneNetwork(DEUTAN).state_dict().items()} for _ in range(2)),
    )
    for factor in (1e-6, 1.0, 1e6):
        corrected = generator.corrected(state, {name: factor * value for name, value in gradient.items()})
        sizes = [float((corrected[name] - value).square().mean().sqrt()) for name, value in state.items()]
        assert sizes == pytest.approx(generator.rates.exp().tolist(), rel=1e-3)


def test_where_the_objective_is_flat_nothing_is_corrected():
    state = SceneNetwork(DEUTAN).state_dict()
    corrected = random_generator().corrected(state, {name: torch.zeros_like(value) for name, value in state.items()})
    assert all(torch.equal(corrected[name], value) for name, value in state.items())


def test_attention_finds_no_features_where_nothing_is_covered():
    generator = random_generator()
    told = condition(DEUTAN, palette([noise(8, 8)]), 2.0)[None]
    assert told.shape == (1, CONDITION_FEATURES)
    views, coverage = torch.zeros(1, 6, 32, 32), torch.zeros(1, 1, 32, 32)
    views[..., :16], coverage[..., :16] = 0.25, 1.0
    attended = generator.summary(views, told, coverage)[:, : -generator.votes.size]
    seen = attended.reshape(generator.config.attentions, -1)[:, -6:]
    assert torch.allclose(seen, torch.full_like(seen, 0.25), atol=1e-5)


def test_no_parameter_is_without_effect():
    # Adam scales the rounding errors of such a parameter's gradient up to whole steps: no two trainings are the same.
    generator = random_generator().double().requires_grad_(True)
    views = torch.rand(2, 6, 2 * STRIDE, 2 * STRIDE, dtype=torch.float64)
    told = torch.rand(2, CONDITION_FEATURES, dtype=torch.float64)
    start = torch.zeros(2, 9, 9, 9, 3, dtype=torch.float64)
    summary = generator.summary(views, told)
    states = [generator(summary, told, start + 0.1, direction) for direction in DIRECTIONS]
    states.append(generator.corrected(states[0], {name: torch.rand_like(value) for name, value in states[0].items()}))
    loss = torch.stack([value.pow(2).sum() for state in states for value in state.values()]).sum()
    names, parameters = zip(*generator.named_parameters(), strict=True)
    gradients = torch.autograd.grad(loss, parameters)
    assert [n for n, gradient in zip(names, gradients, strict=True) if gradient.abs().max() < 1e-9] == []
