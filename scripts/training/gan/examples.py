"""What the generator learns from: drawn scenes, and for some of them the scene network that a fit finds.

Scene k of a stream follows from the seed and k alone, so that a training that goes on sees what it would have seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ....core.color.simulation import Observer
from ....core.enhance.gan.prediction import SIDE
from ....core.enhance.scene.fit import FitSettings, default_budget, fit_network
from ....core.enhance.scene.network import SceneNetwork
from ....core.enhance.scene.storage import load_network, save_network
from ....core.files.untrusted import replacing
from ..data.kinds import KIND_SHARES, draw, draw_observers

DRAWN, PAIRED, KEPT = 0, 1, 2
"""Streams of scenes: those without a fitted network, those with one, and those that are kept from training."""

# A third of the default fit's time; the views are as small as the generator's.
PAIR_FIT = FitSettings(size=SIDE, start_steps=10, table_steps=1, steps=60)
"""How the networks of the pairs are fitted."""

_LARGE = round(1.5 * SIDE)  # pixels a side, of a drawing that several views are cut from
_VIEWS = (1, 1, 2, 3)  # how many a scene has, with equal probability
_BUDGETS = (0.3, 8.0)  # mean ΔE00
_SPREAD = 0.5  # deviation of the logarithm of a budget about the default one


@dataclass(frozen=True)
class Drawing:
    """The views of a drawn scene.

    Attributes:
        views: (SIDE, SIDE, 3) uint8.
        confuses: the type of deficiency that its colours were chosen for, or None.
    """

    views: tuple[NDArray[np.uint8], ...]
    confuses: str | None


@dataclass(frozen=True)
class Scene:
    """A drawing, and who looks at it.

    Attributes:
        drawing: its views.
        observer: who looks.
        budget: mean ΔE00 by which colours may change.
        fitted: the network that a fit found for this budget, or None.
    """

    drawing: Drawing
    observer: Observer
    budget: float
    fitted: SceneNetwork | None = None

    def view(self, number: int) -> Tensor:
        """(3, SIDE, SIDE) in [0, 1]."""
        return torch.from_numpy(self.drawing.views[number].transpose(2, 0, 1).copy()).float() / 255.0


@lru_cache(512)
def draw_scene(seed: int, stream: int, number: int) -> Drawing:
    """A scene of a stream."""
    generator = np.random.default_rng([seed, stream, number])
    kinds, shares = list(KIND_SHARES), np.array(list(KIND_SHARES.values()))
    kind = str(generator.choice(kinds, p=shares / shares.sum()))
    count = int(generator.choice(_VIEWS))
    side = SIDE if count == 1 else _LARGE
    drawing = draw(kind, side, side, generator)
    views = []
    for _ in range(count):
        top, left = generator.integers(0, side - SIDE + 1, 2)
        views.append(np.ascontiguousarray(drawing.image[top : top + SIDE, left : left + SIDE]))
    return Drawing(tuple(views), drawing.confuses)


def watched(drawing: Drawing, generator: np.random.Generator) -> Scene:
    """The drawing with an observer and a budget that are drawn for it."""
    (observer,) = draw_observers(1, drawing.confuses if generator.random() < 0.5 else None, generator)
    budget = default_budget(drawing.views, observer) * float(np.exp(_SPREAD * generator.standard_normal()))
    return Scene(drawing, observer, float(np.clip(budget, *_BUDGETS)))


class Pairs:
    """Scenes with the networks that fits found for them; fitted when first asked for, and kept in files.

    Args:
        folder: for the files; created as needed.
        seed: of the scenes.
        stream: `PAIRED` or `KEPT`.
    """

    def __init__(self, folder: Path, seed: int, stream: int = PAIRED) -> None:
        self._folder, self._seed, self._stream = folder, seed, stream
        self._scenes: dict[int, Scene] = {}

    def __getitem__(self, number: int) -> Scene:
        """The pair of this number.

        Raises:
            InputError: its file cannot be used.
        """
        if number not in self._scenes:
            self._scenes[number] = self._pair(number)
        return self._scenes[number]

    def _pair(self, number: int) -> Scene:
        generator = np.random.default_rng([self._seed, self._stream, number, 1])
        scene = watched(draw_scene(self._seed, self._stream, number), generator)
        path = self._folder / f"{self._stream}-{number:05d}.safetensors"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            views: Sequence[NDArray[np.uint8]] = scene.drawing.views
            fitted = fit_network(views, scene.observer, budget=scene.budget, settings=PAIR_FIT, seed=number)
            with replacing(path) as temporary:
                save_network(fitted, temporary)
        return replace(scene, fitted=load_network(path).network)
