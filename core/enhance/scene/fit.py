"""Fits the scene network to the views of a scene: which of two starts, then the table alone, then all of it.

The weight of naturalness follows a budget, the mean ΔE00 by which colours may change: it rises while they change more
and falls while they change less (dual ascent), so that the budget is spent where it brings back most contrast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...color.simulation import Observer
from ...runtime.protocol import Reporter
from ...runtime.threads import one_thread
from ..descent import Adam
from ..lut_fit import initial_residual
from ..pairs import Alphas, Images
from .network import SceneNetwork, features, table_roughness
from .objective import Objective, ObjectiveWeights, lost_contrast
from .views import chosen_views, reduced

STAGE = "enhance"


@dataclass(frozen=True)
class FitSettings:
    """Constants of the fit.

    Attributes:
        size: longer side of the views that it sees, in pixels.
        judged_size: longer side of the views on which it is counted how much contrast is lost, in pixels.
        views: the most views that it sees, spread over the scene.
        shifts: starts that are tried: the share of the coordinate of CIELAB that an observer loses which is given to a
            visible one. Colours that look alike can be moved apart in either direction.
        start_steps, start_rate: Adam steps with the table alone from each start, and their rate.
        table_steps: with the table alone from the better one; what they give is the scene's LUT.
        steps: with the whole network.
        rate, ramp: of Adam, at its highest; steps over which it rises to that.
        start_weight: of naturalness for the starts.
        weight: of naturalness at first.
        roughness: weight of the table's roughness.
        budget_share, budget_base: the budget where none is given is `budget_base` + `budget_share` · what is lost: of
            the contrast between distinct neighbours, or, where that is more, `coarse_share` of what is lost between
            surfaces. The digit of a colour plate differs from its ground in hue alone, but dots from their neighbours
            in lightness: all contrast seems to be there.
        objective: weights of its terms.
    """

    size: int = 160
    judged_size: int = 384
    views: int = 6
    shifts: tuple[float, ...] = (0.3, -0.3)
    start_steps: int = 16
    start_rate: float = 8e-3
    table_steps: int = 24
    steps: int = 120
    rate: float = 4e-3
    ramp: int = 10
    start_weight: float = 0.05
    weight: float = 0.1
    roughness: float = 1000.0
    budget_share: float = 12.0
    budget_base: float = 0.2
    coarse_share: float = 0.7
    objective: ObjectiveWeights = field(default_factory=ObjectiveWeights)


START_WEIGHTS = ObjectiveWeights(neighbours=80.0, areas=18.0)
"""Of the objective where given starts are judged, and where predicted ones are trained.

A prediction is coarser than a fit: by the fit's weights it would rather hold whole surfaces apart than restore the
contrast of neighbours, which CCPR counts.
"""

_BETAS = (0.9, 0.99)  # of Adam; short, because a fit is
_CHANGE_DECAY = 0.8  # of the exponential moving average of the change, which the weight of naturalness follows
_GAIN, _MOST_EXCESS = 0.1, 0.5  # how fast that weight follows, and the relative excess beyond which no faster
_LEAST_WEIGHT, _MOST_WEIGHT = 0.003, 5.0
_LAX_WEIGHT = 0.02  # of naturalness; where it sinks below, the budget is not spent, and structure is eased too
_LEAST_EASE = 0.5
_SCALINGS = 4  # at most, of a change to the budget; ΔE00 is not quite proportional to it
_NEARLY = 0.98  # of the budget is near enough
_LEAST_CHANGE = 1e-6  # mean ΔE00
_LEAST_SCALE, _MOST_SCALE = 0.01, 3.0  # of a start's change
_BUDGET_PARTS = (1.0, 0.85, 0.7, 0.55, 0.4)  # of the budget that are tried for a start, the largest first


@dataclass(frozen=True)
class FittedNetwork:
    """What a fit gives.

    Attributes:
        network: fitted.
        table: (N, N, N, 3), what a table alone can do, for tools that know nothing of surroundings.
        budget: mean ΔE00 that it was fitted to.
        change: mean ΔE00 of the views that the fit saw.
    """

    network: SceneNetwork
    table: Tensor
    budget: float
    change: float


def fit_network(
    images: Images,
    observer: Observer,
    *,
    alphas: Alphas = None,
    budget: float | None = None,
    starts: Sequence[SceneNetwork] = (),
    start_weights: ObjectiveWeights = START_WEIGHTS,
    settings: FitSettings = FitSettings(),
    seed: int = 0,
    reporter: Reporter | None = None,
) -> FittedNetwork:
    """Fit a network to a scene's views; deterministic for a seed.

    Args:
        images, alphas: the views; at most `settings.views` of them are looked at.
        observer: who is to tell things apart, of a severity above 0.
        budget: mean ΔE00 by which colours may change; None to take it from how much contrast the observer loses.
        starts: networks for the observer, such as predicted ones. The fit goes on from the best of them, once their
            change is scaled to the budget or to what part of it is enough; they are left as they are.
        start_weights: of the objective by which they are judged.

    Raises:
        InputError: no view has a covered pixel.
    """
    with one_thread():
        return _Fit(images, observer, alphas, budget, settings, seed, reporter or Reporter()).run(starts, start_weights)


def default_budget(
    images: Images, observer: Observer, alphas: Alphas = None, settings: FitSettings = FitSettings()
) -> float:
    """Mean ΔE00 by which the colours of a scene may change, from how much contrast the observer loses.

    Args:
        images, observer, alphas: as for `fit_network`.

    Raises:
        InputError: no view has a covered pixel.
    """
    views = [reduced(*view, settings.judged_size) for view in chosen_views(images, alphas, settings.views)]
    lost = [lost_contrast(pixels, observer, coverage) for pixels, coverage in views]
    fine, coarse = (sum(one) / len(lost) for one in zip(*lost, strict=True))
    return settings.budget_base + settings.budget_share * max(fine, settings.coarse_share * coarse)


@dataclass(frozen=True)
class _View:
    """A view as the fit sees it: its objective, colours (P, 3) and features (P, 25)."""

    objective: Objective
    colors: Tensor
    features: Tensor

    def shown(self, network: SceneNetwork, *, whole: bool) -> Tensor:
        """(3, H, W) the enhanced view, not clipped; `whole`: with the perceptron."""
        shown = network(self.colors, self.features if whole else None)
        return shown.T.reshape(self.objective.image.shape)

    def change(self, network: SceneNetwork, *, whole: bool) -> float:
        """Mean ΔE00 by which a network changes the view; `whole` as above."""
        judged = self.objective.judged
        return self.objective.change_of(network(self.colors[judged], self.features[judged] if whole else None))


class _Fit:
    """One fit."""

    def __init__(
        self,
        images: Images,
        observer: Observer,
        alphas: Alphas,
        budget: float | None,
        settings: FitSettings,
        seed: int,
        reporter: Reporter,
    ) -> None:
        self._observer, self._settings, self._reporter = observer, settings, reporter
        self._torch_generator = torch.Generator().manual_seed(seed)
        self._generator = np.random.default_rng(seed)
        chosen = chosen_views(images, alphas, settings.views)
        self._views = [self._view(*view) for view in chosen]
        if budget is None:
            budget = default_budget([image for image, _ in chosen], observer, [alpha for _, alpha in chosen], settings)
        self._budget = budget
        self._weight = settings.weight
        self._mean_change: float | None = None
        self._total = settings.table_steps + settings.steps
        self._done = 0

    def run(self, starts: Sequence[SceneNetwork], start_weights: ObjectiveWeights) -> FittedNetwork:
        """Fit, from the best of some starts or of the settings' own."""
        network, alone = SceneNetwork(self._observer), SceneNetwork(self._observer)
        if not starts:
            self._total += len(self._settings.shifts) * self._settings.start_steps
            self._initialise(network)
            alone.table.data.copy_(self._best_start())
        else:
            # From less than the budget where that serves: a short fit finds its way back from too much more slowly.
            network = self._best_scaled(self._nearest(starts, start_weights), start_weights)
            alone.table.data.copy_(network.table.data)
        start = deepcopy(network)
        self._optimise(alone, [alone.table], self._settings.table_steps, whole=False)
        if not starts:
            network.table.data.copy_(alone.table.data)
        table = self._at_budget(alone, whole=False).table.detach()
        self._weight, self._mean_change = self._settings.weight, None
        self._optimise(network, list(network.parameters()), self._settings.steps, whole=True)
        if not starts:
            network = self._at_budget(network, whole=True)
        elif self._settings.steps:
            # A short fit ends before the weight of naturalness has found what the scene needs. With a budget far below
            # that, it may end with less contrast than it began with.
            weights = self._settings.objective
            ends = [self._best_scaled(network, weights), start]
            network = min(ends, key=lambda one: self._score(self._shown(one), weights))
        self._reporter.progress(STAGE, 1.0)
        return FittedNetwork(network.requires_grad_(False), table, self._budget, self._change(network, whole=True))

    def _view(self, image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None) -> _View:
        pixels, coverage = reduced(image, alpha, self._settings.size)
        objective = Objective(pixels, self._observer, coverage, self._torch_generator, self._settings.objective)
        return _View(
            objective,
            pixels.flatten(1).T.contiguous(),
            features(pixels, self._observer, coverage),
        )

    def _initialise(self, network: SceneNetwork) -> None:
        """Random hidden layers from the seed, as torch's own initialisation would draw them."""
        for layer in (network.first, network.second):
            bound = 1.0 / math.sqrt(layer.in_features)
            for values in (layer.weight, layer.bias):
                torch.nn.init.uniform_(values, -bound, bound, generator=self._torch_generator)

    def _best_start(self) -> Tensor:
        """The table of the start with the least objective after a few steps."""
        tables = []
        for shift in self._settings.shifts:
            network = SceneNetwork(self._observer)
            network.table.data.copy_(initial_residual(self._observer, network.table.shape[0], shift))
            optimiser = Adam([network.table])
            for step in range(self._settings.start_steps):
                view = self._views[step % len(self._views)]
                loss = view.objective(view.shown(network, whole=False), self._settings.start_weight)
                self._descend(optimiser, network, loss, self._settings.start_rate)
            with torch.no_grad():
                shown = [(view.objective, view.shown(network, whole=False)) for view in self._views]
                score = sum(float(objective(one, self._settings.start_weight)) for objective, one in shown)
            tables.append((score, network.table.detach()))
        return min(tables, key=lambda pair: pair[0])[1]

    def _optimise(self, network: SceneNetwork, parameters: Sequence[Tensor], steps: int, *, whole: bool) -> None:
        """Adam on one view a step, while the weight of naturalness follows the budget."""
        optimiser = Adam(parameters, _BETAS)
        for step in range(steps):
            rate = self._settings.rate * min(1.0, (step + 1) / self._settings.ramp, 2.0 * (1.0 - step / steps) + 0.02)
            view = self._views[self._generator.integers(len(self._views))]
            shown = view.shown(network, whole=whole)
            ease = min(max(self._weight / _LAX_WEIGHT, _LEAST_EASE), 1.0)
            self._descend(optimiser, network, view.objective(shown, self._weight, ease), rate)
            self._follow_budget(view.objective.change(shown))

    def _descend(self, optimiser: Adam, network: SceneNetwork, loss: Tensor, rate: float) -> None:
        optimiser.descend(loss + self._settings.roughness * table_roughness(network.table), rate)
        self._done += 1
        self._reporter.progress(STAGE, self._done / self._total)

    def _follow_budget(self, change: float) -> None:
        mean = self._mean_change
        self._mean_change = change if mean is None else _CHANGE_DECAY * mean + (1.0 - _CHANGE_DECAY) * change
        excess = min(max(self._mean_change / self._budget - 1.0, -_MOST_EXCESS), _MOST_EXCESS)
        self._weight = min(max(self._weight * math.exp(_GAIN * excess), _LEAST_WEIGHT), _MOST_WEIGHT)

    def _at_budget(self, network: SceneNetwork, *, whole: bool, least: float = 0.0, most: float = 1.0) -> SceneNetwork:
        """A copy whose change is scaled towards the budget, by factors from `least` to `most`."""
        copy, factor = SceneNetwork(self._observer), 1.0
        copy.load_state_dict(network.state_dict())
        for _ in range(_SCALINGS):
            change = self._change(copy, whole=whole)
            wanted = min(max(factor * self._budget / max(change, _LEAST_CHANGE), least), most)
            if wanted == factor or _NEARLY < change / self._budget <= 1.0:
                break
            copy.scale(wanted / factor)
            factor = wanted
        return copy

    def _nearest(self, starts: Sequence[SceneNetwork], weights: ObjectiveWeights) -> SceneNetwork:
        """A copy of the start that has the least objective once its change is scaled to the budget."""
        scaled = [self._at_budget(start, whole=True, least=_LEAST_SCALE, most=_MOST_SCALE) for start in starts]
        if len(scaled) == 1:
            return scaled[0]
        return min(scaled, key=lambda one: self._score(self._shown(one), weights))

    def _best_scaled(self, network: SceneNetwork, weights: ObjectiveWeights) -> SceneNetwork:
        """A copy whose change is scaled to the budget, or to a part of it where that is enough for the objective."""
        copy = self._at_budget(network, whole=True, least=_LEAST_SCALE, most=_MOST_SCALE)
        ends = [(view.objective.image, shown) for view, shown in zip(self._views, self._shown(copy), strict=True)]

        def score(part: float) -> float:
            return self._score([torch.lerp(original, shown, part) for original, shown in ends], weights)

        copy.scale(min(_BUDGET_PARTS, key=score))
        return copy

    def _shown(self, network: SceneNetwork) -> list[Tensor]:
        """The views as the whole network enhances them."""
        with torch.no_grad():
            return [view.shown(network, whole=True) for view in self._views]

    def _score(self, shown: Sequence[Tensor], weights: ObjectiveWeights) -> float:
        """The objective of all enhanced views, with some weights of its terms."""
        with torch.no_grad():
            return sum(
                float(view.objective(one, _LAX_WEIGHT, weights=weights))
                for view, one in zip(self._views, shown, strict=True)
            )

    def _change(self, network: SceneNetwork, *, whole: bool) -> float:
        with torch.no_grad():
            changes = [view.change(network, whole=whole) for view in self._views]
        return sum(changes) / len(changes)
