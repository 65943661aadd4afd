"""A prediction is tried at its budget: what it shows, how good that is, and where the objective rises."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cvdgs.core.color.simulation import Observer
from cvdgs.core.color.spaces import delta_e_2000
from cvdgs.core.enhance.gan.networks import State
from cvdgs.core.enhance.gan.prediction import start_table
from cvdgs.core.enhance.gan.trial import Trial, View
from cvdgs.core.enhance.scene.network import SceneNetwork

from ..textiles import tartan

DEUTAN, BUDGET = Observer("deutan", 1.0), 2.0


def view(size: int = 48) -> View:
    return torch.from_numpy(tartan(size=size).transpose(2, 0, 1).copy()).float() / 255.0, None


def trial(*views: View, budget: float = BUDGET) -> Trial:
    return Trial(views or [view()], DEUTAN, budget, generator=torch.Generator().manual_seed(0))


def state(table: float = 1.0) -> State:
    """Of a network that makes visible what is lost, with a perceptron that does something."""
    torch.manual_seed(1)
    network = SceneNetwork(DEUTAN)
    torch.nn.init.normal_(network.last.weight, std=0.05)
    network.table.data.copy_(table * start_table(DEUTAN))
    return {name: value.detach() for name, value in network.state_dict().items()}


@pytest.mark.parametrize("budget", [0.5, BUDGET])
def test_what_is_shown_has_the_budget(budget):
    pixels, _ = view()
    _, (shown,) = trial(budget=budget).loss(state())
    assert float(delta_e_2000(pixels, shown.clamp(0.0, 1.0)).mean()) == pytest.approx(budget, rel=0.15)


def test_no_change_has_the_untouched_pictures_objective():
    unchanged = {name: torch.zeros_like(value) for name, value in state().items()}
    assert float(trial().loss(unchanged)[0]) == pytest.approx(1.0, abs=1e-5)


def test_the_better_of_some_predictions_has_the_least_objective():
    states = [state(-1.0), state(1.0), state(0.1)]
    judge = trial()
    losses = [float(judge.loss(one)[0]) for one in states]
    assert judge.better(states) == int(np.argmin(losses))


def test_a_draft_is_the_prediction_at_its_budget():
    judge = trial()
    draft = judge.draft(state())
    assert draft.loss == pytest.approx(float(judge.loss(state())[0]), rel=0.02)
    again = judge.draft(draft.state)
    for name, value in draft.state.items():
        assert torch.allclose(value, again.state[name], rtol=0.05, atol=1e-4)


def test_a_small_step_against_the_gradient_lowers_the_objective():
    judge = trial()
    draft = judge.draft(state())
    length = torch.stack([value.square().sum() for value in draft.gradient.values()]).sum().sqrt()
    behind, ahead = (
        float(judge.loss({n: v + step / length * draft.gradient[n] for n, v in draft.state.items()})[0])
        for step in (-1e-3, 1e-3)
    )
    assert behind < draft.loss < ahead


def test_all_views_count():
    draft = trial(view(48), view(32)).draft(state())
    single = [trial(view(size)).draft(state()).loss for size in (48, 32)]
    assert min(single) - 0.05 < draft.loss < max(single) + 0.05


def test_what_is_not_covered_does_not_count():
    pixels, _ = view()
    coverage = torch.zeros(48, 48)
    coverage[:, :24] = 1.0
    other = pixels.clone()
    other[:, :, 28:] = 0.5
    losses = [trial((one, coverage)).draft(state()).loss for one in (pixels, other)]
    assert losses[0] == pytest.approx(losses[1], rel=0.02)
