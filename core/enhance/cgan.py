"""The enhancer that is trained beforehand: a conditional GAN predicts the scene network, which a few steps then fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..errors import InputError
from ..runtime.protocol import Reporter
from ..runtime.threads import one_thread
from ..settings import Settings
from .gan.networks import Generator
from .gan.prediction import predict_corrected, predict_networks
from .gan.weights import load_generator, load_shipped
from .pairs import Alphas, Images
from .scene.enhancer import SceneNetworkEnhancer
from .scene.fit import FitSettings, default_budget, fit_network

_SHORT_FIT = FitSettings(ramp=3)
_LONG_STEPS, _MOST_FACTOR = 100, 2.0  # a fit of fewer steps takes longer ones, by this factor at most


class CganEnhancer(SceneNetworkEnhancer):
    """Recolours with one scene network, which a generator predicts from the views and a few steps fit to them.

    Args:
        budget: mean ΔE00 by which colours may change; None to take it from the photographs.
        weights: a file of `gan.weights`; None for the shipped one.
        fit_steps: of the fit; 0 corrects the prediction instead.

    Raises:
        InputError: also weights that cannot be used.
    """

    name = "cgan"

    def __init__(
        self,
        cvd: str,
        severity: float,
        simulation: str = "machado",
        strength: float = 1.0,
        seed: int = 0,
        budget: float | None = None,
        weights: Path | None = None,
        fit_steps: int = Settings.fit,
    ) -> None:
        if fit_steps < 0:
            raise InputError(f"{fit_steps} steps are out of range", where="--fit", remedy="give 0 or more")
        rate = _SHORT_FIT.rate * min(max(_LONG_STEPS / max(fit_steps, 1), 1.0), _MOST_FACTOR)
        table_steps = min(fit_steps, _SHORT_FIT.table_steps)
        settings = replace(_SHORT_FIT, steps=fit_steps, table_steps=table_steps, rate=rate)
        super().__init__(cvd, severity, simulation, strength, seed, budget, settings)
        self._load: Callable[[], Generator] = partial(load_generator, weights) if weights else load_shipped
        self._generator: Generator | None = self._load()

    def _fit(self, images: Images, reporter: Reporter, alphas: Alphas) -> None:
        # What is fitted needs it no more; of unrelated photographs, each keeps an enhancer.
        generator, self._generator = self._generator or self._load(), None
        # Another number of threads rounds sums over pixels otherwise, and what is predicted from them would follow.
        with one_thread():
            budget = self._budget
            if budget is None:
                budget = default_budget(images, self._observer, alphas, self._settings)
            scene = (generator, images, self._observer, budget, alphas)
            # A fit ends no better from corrected predictions.
            starts = predict_networks(*scene) if self._settings.steps else predict_corrected(*scene)
        self._take(
            fit_network(
                images,
                self._observer,
                alphas=alphas,
                budget=budget,
                starts=starts,
                settings=self._settings,
                seed=self._seed,
                reporter=reporter,
            )
        )
