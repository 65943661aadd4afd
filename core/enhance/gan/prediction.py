"""Predicts scene networks: one for all views of a scene, in each of two directions, and corrects them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn import functional

from ...color.simulation import Observer
from ...color.spaces import tensor_to_image
from ...files.images import to_bytes
from ..lut_fit import initial_residual
from ..pairs import Alphas, Images
from ..scene.network import NODES, SceneNetwork, seen_features
from ..scene.views import chosen_views, reduced
from .conditioning import condition, palette
from .networks import DIRECTIONS, STRIDE, Generator, State
from .trial import Trial, View

SIDE = 112
"""Longer side, in pixels, of the views that the generator sees."""

_VIEWS = 6  # at most that it looks at
_CORRECTIONS = 2  # at most
_START = 0.3  # share of what is lost that the start makes visible, as the fit's first start


def predict_networks(
    generator: Generator, images: Images, observer: Observer, budget: float, alphas: Alphas = None
) -> list[SceneNetwork]:
    """The networks for a scene, one of each of `DIRECTIONS`, not yet scaled to the budget.

    Args:
        images: (H, W, 3) uint8 views; at most six are looked at, spread over the scene.
        observer: for whom.
        budget: mean ΔE00 by which colours may change.
        alphas: (H, W) coverage per view or None.

    Raises:
        InputError: no view has a covered pixel.
    """
    views = _looked_at(images, alphas)
    return [_network(state, observer) for state in _predicted(generator, views, observer, budget)]


def predict_corrected(
    generator: Generator, images: Images, observer: Observer, budget: float, alphas: Alphas = None
) -> list[SceneNetwork]:
    """The networks of `predict_networks`, at the budget, and each corrected as long as that makes it better.

    Arguments and errors as there.
    """
    views = _looked_at(images, alphas)
    trial = Trial(views, observer, budget, generator=torch.Generator().manual_seed(0))
    states = _predicted(generator, views, observer, budget)
    return [_network(_corrected(generator, trial, state), observer) for state in states]


def _corrected(generator: Generator, trial: Trial, state: State) -> State:
    draft = trial.draft(state)
    for _ in range(_CORRECTIONS):
        corrected = trial.draft(generator.corrected(draft.state, draft.gradient))
        if corrected.loss >= draft.loss:
            break
        draft = corrected
    return draft.state


def _looked_at(images: Images, alphas: Alphas) -> list[View]:
    return [reduced(image, alpha, SIDE) for image, alpha in chosen_views(images, alphas, _VIEWS)]


def _predicted(generator: Generator, views: Sequence[View], observer: Observer, budget: float) -> list[State]:
    conditioning = scene_condition(views, observer, budget)[None]
    with torch.no_grad():
        summaries = [
            generator.summary(*_resized(pixels, observer, conditioning, coverage)) for pixels, coverage in views
        ]
        summary, start = torch.stack(summaries).mean(0), start_table(observer)[None]
        states = [generator(summary, conditioning, start, direction) for direction in DIRECTIONS]
    return [{name: values[0].clone() for name, values in state.items()} for state in states]


def _network(state: State, observer: Observer) -> SceneNetwork:
    network = SceneNetwork(observer)
    network.load_state_dict(state)
    return network


def scene_condition(views: Sequence[View], observer: Observer, budget: float) -> Tensor:
    """(CONDITION_FEATURES,) of a scene from its (3, H, W) views and their (H, W) coverage."""
    images = [tensor_to_image(pixels) for pixels, _ in views]
    alphas = [None if coverage is None else to_bytes(coverage.numpy()) for _, coverage in views]
    return condition(observer, palette(images, alphas), budget)


@lru_cache(64)
def start_table(observer: Observer) -> Tensor:
    """(N, N, N, 3) what the observer loses, made visible: the start that a generator is given."""
    return initial_residual(observer, NODES, _START)


def _resized(
    pixels: Tensor, observer: Observer, conditioning: Tensor, coverage: Tensor | None
) -> tuple[Tensor, Tensor, Tensor | None]:
    """The arguments of `Generator.summary` for one view, with sides that are multiples of `STRIDE`."""
    shape = [max(round(side / STRIDE), 1) * STRIDE for side in pixels.shape[-2:]]

    def resize(maps: Tensor) -> Tensor:
        return functional.interpolate(maps[None], shape, mode="bilinear", antialias=True)

    return resize(seen_features(pixels, observer)), conditioning, None if coverage is None else resize(coverage[None])
