"""Tries predictions on a scene's views: how good is what they show at the budget, and what would make it better?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.func import functional_call

from ...color.simulation import Observer
from ...color.spaces import srgb_to_lab
from ..scene.fit import START_WEIGHTS, FitSettings
from ..scene.network import PROPORTIONAL, TABLE, SceneNetwork, features, table_roughness
from ..scene.objective import Objective, ObjectiveWeights, smooth_change
from .networks import State

View = tuple[Tensor, Tensor | None]
"""(3, H, W) sRGB in [0, 1], and (H, W) coverage in [0, 1] or None where all is covered."""

CORRECTION_WEIGHTS = replace(START_WEIGHTS, invented=14.0)
"""Of the objective that corrections follow. With `START_WEIGHTS`, what contrast they restore is paid for in CCFR."""

_LEAST_OBJECTIVE = 3.0  # an untouched picture with less has hardly anything to gain
_LEAST_CHANGE = 1e-3  # mean ΔE
_SCALES = (0.01, 3.0)  # of a predicted change, to the budget
_ROUGHNESS = 0.3 * FitSettings().roughness  # it adds up over the scenes of a training; a fit takes out the rest


@dataclass(frozen=True)
class Draft:
    """A prediction at its budget.

    Attributes:
        state: of the scene network.
        loss: the relative objective.
        gradient: of that with respect to the state.
    """

    state: State
    loss: float
    gradient: State


class Trial:
    """The views of a scene, with what is needed to judge and to correct a prediction.

    Args:
        views: of the scene.
        observer: who looks.
        budget: mean ΔE00 by which colours may change.
        weights: of the objective.
        generator: draws the objective's random pairs; None for torch's own.
    """

    def __init__(
        self,
        views: Sequence[View],
        observer: Observer,
        budget: float,
        weights: ObjectiveWeights = CORRECTION_WEIGHTS,
        generator: torch.Generator | None = None,
    ) -> None:
        self._observer, self._budget = observer, budget
        self._views = [pixels for pixels, _ in views]
        self._objectives = [Objective(pixels, observer, coverage, generator, weights) for pixels, coverage in views]
        self._colors = [pixels.flatten(1).T.contiguous() for pixels in self._views]
        self._features = [features(pixels, observer, coverage) for pixels, coverage in views]
        with torch.no_grad():
            self._before = max(float(self._mean(self._views)), _LEAST_OBJECTIVE)

    def loss(self, state: State) -> tuple[Tensor, list[Tensor]]:
        """The relative objective of a prediction at the budget, and the (3, H, W) views that it shows, not clipped."""
        predicted = self._predicted(state)
        scale = self._scale(predicted)
        shown = [view + scale * (one - view) for view, one in zip(self._views, predicted, strict=True)]
        rough = table_roughness(scale * state[TABLE])
        return (self._mean(shown) + _ROUGHNESS * rough) / self._before, shown

    def better(self, states: Sequence[State]) -> int:
        """Which of some predictions has the least objective."""
        with torch.no_grad():
            losses = [float(self.loss(state)[0]) for state in states]
        return losses.index(min(losses))

    def draft(self, state: State) -> Draft:
        """A prediction at its budget, with the objective's gradient there."""
        with torch.no_grad():
            scale = self._scale(self._predicted(state))
        leaves = {
            name: (scale * value if name in PROPORTIONAL else value).detach().requires_grad_()
            for name, value in state.items()
        }
        with torch.enable_grad():
            loss, _ = self.loss(leaves)
        gradient = torch.autograd.grad(loss, list(leaves.values()))
        return Draft(
            {name: value.detach() for name, value in leaves.items()},
            float(loss.detach()),
            dict(zip(leaves, gradient, strict=True)),
        )

    def _predicted(self, state: State) -> list[Tensor]:
        network = SceneNetwork(self._observer)
        return [
            functional_call(network, state, tuple(pixels)).T.reshape(view.shape)
            for view, *pixels in zip(self._views, self._colors, self._features, strict=True)
        ]

    def _mean(self, shown: Sequence[Tensor]) -> Tensor:
        values = [objective(one, 0.0) for objective, one in zip(self._objectives, shown, strict=True)]
        return torch.stack(values).mean()

    def _scale(self, predicted: Sequence[Tensor]) -> Tensor:
        """What the change is multiplied by to have the budget; its slope is that of a smooth ΔE."""
        pairs = list(zip(self._views, predicted, strict=True))
        changes = [objective.change(one) for objective, one in zip(self._objectives, predicted, strict=True)]
        scale = self._budget / max(sum(changes) / len(changes), _LEAST_CHANGE)
        smooth = [smooth_change(srgb_to_lab(view), srgb_to_lab(one.clamp(0.0, 1.0))).mean() for view, one in pairs]
        change = torch.stack(smooth).mean() + _LEAST_CHANGE
        return min(max(scale, _SCALES[0]), _SCALES[1]) * (change.detach() / change)
