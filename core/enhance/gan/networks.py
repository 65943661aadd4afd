"""The generator: looks at a scene's views at low resolution, and gives the parameters of a scene network.

A U-Net (Isola et al. 2017) reads every view: the colours, and what the observer sees differently. It is steered by the
observer, the scene's palette and the budget (feature-wise modulation, Perez et al. 2018). Its output are a few pictures
of attention and some features; each attention takes the mean of features and colours over what it points at. What the
views have in common by that, their mean, becomes one code of the scene, and the code the network's parameters:

    parameters = base + direction · base' + basis · code
    table += direction · share · (what the observer loses, made visible)
    table += mean of the pixels' votes

Every pixel votes for how its own colour is to be shifted. It sees what surrounds it, and so which colours look alike
and have to be moved apart; the code alone would have to remember where on the table each of them is.

One prediction holds for the whole scene, so that all views agree as they do after a fit. There are two of them: colours
that look alike can be moved apart in either direction, as a fit tries both, and which is better the objective tells
better than a generator could guess. Their change is to be scaled to the budget, so the generator decides about colours
and places only.

Where no fit follows, predictions are corrected: by steps down the objective's gradient whose sizes are learned too, as
in Meta-SGD (Li et al. 2017).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from ...color.simulation import Observer
from ..scene.network import TABLE, SceneNetwork
from .conditioning import CONDITION_FEATURES
from .votes import SLOPE, Votes

State = dict[str, Tensor]
"""The state of a `SceneNetwork` by name."""

DIRECTIONS = (1.0, -1.0)
"""Of the two predictions: along the start that makes visible what an observer loses, and against it."""

STRIDE = 16
"""Sides of the generator's views are multiples of this, in pixels."""

_SEEN = 6  # channels of a view: `seen_features`
_HIDDEN = 128  # between the summary of the views and the code
_TABLE_SCALE, _PERCEPTRON_SCALE = 0.05, 0.3  # bring both parts of the parameters to the order of 1
_LAST_SCALE = 0.01  # of the perceptron's last layer at first: next to nothing
_FIRST_RATE = 0.01  # of a correction, at first
_LEAST_SIZE = 1e-12  # of a gradient


@dataclass(frozen=True)
class GeneratorConfig:
    """The network's shape; stored with its weights.

    Attributes:
        widths: channels at half the resolution, at a quarter, an eighth, a sixteenth.
        attentions: pictures of attention.
        embedding: width of the vector that steers the U-Net.
        code: width of the scene's code: so many changes of the parameters are learned.
    """

    widths: tuple[int, ...] = (16, 24, 32, 48)
    attentions: int = 12
    embedding: int = 48
    code: int = 48

    def to_dict(self) -> dict[str, Any]:
        """JSON values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> GeneratorConfig:
        """From what `to_dict` gave.

        Raises:
            ValueError: values that no network has.
        """
        config = cls(tuple(values["widths"]), *(values[name] for name in ("attentions", "embedding", "code")))
        numbers = [*config.widths, config.attentions, config.embedding, config.code]
        if len(config.widths) != 4 or not all(type(one) is int and 1 <= one <= 1024 for one in numbers):
            raise ValueError("no such network")
        return config


class Generator(nn.Module):
    """See the module.

    Args:
        config: its shape.

    Attributes:
        rates: logarithms of the sizes of a correction's step, for each tensor of a scene network.
    """

    def __init__(self, config: GeneratorConfig = GeneratorConfig()) -> None:
        super().__init__()
        self.config = config
        widths, embedding = config.widths, config.embedding
        self.steer = nn.Sequential(nn.Linear(CONDITION_FEATURES, 64), nn.SiLU(), nn.Linear(64, embedding), nn.SiLU())
        entering = (_SEEN, *widths[:-1])
        self.down = nn.ModuleList(
            _ModulatedConvolution(before, after, embedding, stride=2)
            for before, after in zip(entering, widths, strict=True)
        )
        rising = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.up = nn.ModuleList(_ModulatedConvolution(below + beside, beside, embedding) for below, beside in rising)
        self.attention = nn.Conv2d(widths[0], config.attentions, 1, bias=False)  # softmax would not see it
        summary = config.attentions * (widths[0] + _SEEN)
        self.hidden = nn.Sequential(nn.Linear(summary + embedding + 1, _HIDDEN), nn.SiLU())
        self.code = nn.Sequential(nn.Linear(_HIDDEN, config.code), nn.SiLU())
        self.share = nn.Linear(config.code, 1)
        self._shapes = {name: value.shape for name, value in SceneNetwork(Observer("deutan", 1.0)).state_dict().items()}
        self.votes = Votes(widths[0] + _SEEN, self._shapes[TABLE][0], len(DIRECTIONS))
        self.parameters_of = nn.Linear(config.code + 1, sum(math.prod(shape) for shape in self._shapes.values()))
        self.rates = nn.Parameter(torch.full((len(self._shapes),), math.log(_FIRST_RATE)))
        self._initialise()

    def _initialise(self) -> None:
        """Any scene's first prediction is the direction that the fit tries first."""
        network = SceneNetwork(Observer("deutan", 1.0))
        nn.init.normal_(network.last.weight, std=_LAST_SCALE)
        start = [value.detach().flatten() / _scale(name) for name, value in network.state_dict().items()]
        with torch.no_grad():
            self.parameters_of.bias.copy_(torch.cat(start))
            self.parameters_of.weight[: math.prod(self._shapes[TABLE])] = 0.0
            self.share.weight.mul_(0.1)
            self.share.bias.fill_(1.0)

    def summary(self, views: Tensor, condition: Tensor, coverage: Tensor | None = None) -> Tensor:
        """(V, S) what the attentions find in each view, and how its pixels vote.

        Args:
            views: (V, 6, H, W) `seen_features`, with sides that are multiples of `STRIDE`.
            condition: (V, CONDITION_FEATURES) of each view's scene.
            coverage: (V, 1, H, W) in [0, 1]; None where all is covered.
        """
        steer, levels, found = self.steer(condition), [], views
        for layer in self.down:
            found = layer(found, steer)
            levels.append(found)
        levels.pop()
        for layer in self.up:
            beside = levels.pop()
            found = layer(torch.cat([functional.interpolate(found, scale_factor=2.0), beside], 1), steer)
        weight = self.attention(found)
        share = torch.ones_like(weight[:, :1]) if coverage is None else functional.avg_pool2d(coverage, 2)
        share = share.clamp(min=torch.finfo(share.dtype).tiny)
        weight = (weight + share.log()).flatten(2).softmax(2)
        seen = functional.avg_pool2d(views, 2)
        values = torch.cat([found, seen], 1)
        attended = torch.einsum("vap,vcp->vac", weight, values.flatten(2)).flatten(1)
        votes = self.votes.sums(values, seen[:, :3] + 0.5, share / share.sum((2, 3), keepdim=True))
        return torch.cat([attended, votes], 1)

    def forward(self, summary: Tensor, condition: Tensor, start: Tensor, direction: float) -> State:
        """The state for each scene, with a first axis for the scenes.

        Args:
            summary: (B, S) mean `summary` of each scene's views.
            condition: (B, CONDITION_FEATURES).
            start: (B, N, N, N, 3) tables that make visible what each observer loses.
            direction: one of `DIRECTIONS`.
        """
        attended, votes = summary.split([summary.shape[1] - self.votes.size, self.votes.size], 1)
        towards = torch.full_like(summary[:, :1], direction)
        code = self.code(self.hidden(torch.cat([attended, self.steer(condition), towards], 1)))
        sizes = [math.prod(shape) for shape in self._shapes.values()]
        parts = zip(
            self._shapes.items(), self.parameters_of(torch.cat([code, towards], 1)).split(sizes, 1), strict=True
        )
        state = {name: _scale(name) * values.reshape(-1, *shape) for (name, shape), values in parts}
        state[TABLE] = state[TABLE] + direction * self.share(code)[:, :, None, None, None] * start
        state[TABLE] = state[TABLE] + self.votes.table(votes, DIRECTIONS.index(direction))
        return state

    def corrected(self, state: State, gradient: State) -> State:
        """A scene's prediction after a step down the objective's gradient.

        Each tensor moves by its rate, whatever the gradient's size: it differs a lot between scenes, and between a
        table and a perceptron.

        Args:
            state: predicted.
            gradient: of the objective with respect to it.
        """
        steps = {
            name: rate * gradient[name] / (gradient[name].square().mean().sqrt() + _LEAST_SIZE)
            for name, rate in zip(self._shapes, self.rates.exp(), strict=True)
        }
        return {name: state[name] - step for name, step in steps.items()}


class _ModulatedConvolution(nn.Module):
    """A convolution with feature-wise linear modulation: the steering vector scales and shifts its result."""

    def __init__(self, before: int, after: int, embedding: int, stride: int = 1) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, 3, stride, 1)
        self.modulation = nn.Linear(embedding, 2 * after)

    def forward(self, found: Tensor, steer: Tensor) -> Tensor:
        scale, shift = self.modulation(steer)[:, :, None, None].chunk(2, 1)
        return functional.leaky_relu(self.convolution(found) * (1.0 + scale) + shift, SLOPE)


def _scale(name: str) -> float:
    return _TABLE_SCALE if name == TABLE else _PERCEPTRON_SCALE
