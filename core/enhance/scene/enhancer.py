"""The enhancer that fits a network of colours and their surroundings to the scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...color.simulation import Observer
from ...errors import InputError
from ...files.images import to_bytes
from ...runtime.protocol import Reporter
from ..enhancer import SceneEnhancer
from ..pairs import Alphas, Images
from .application import recolour
from .fit import FitSettings, FittedNetwork, fit_network
from .network import SceneNetwork, table_lut
from .storage import load_network, save_network


class SceneNetworkEnhancer(SceneEnhancer):
    """Recolours with one scene network, fitted in some seconds; unlike a LUT it sees what surrounds a pixel.

    Args:
        budget: mean ΔE00 by which colours may change; None to take it from the photographs.
        settings: constants of the fit; None for the defaults.
        starts: networks for this observer, such as predicted ones, from the best of which the fit goes on.
        fitted: a network that is fitted already: `fit` leaves it as it is.

    Raises:
        InputError: also a budget that is not above 0, and a fitted network for another observer.
    """

    name = "scene"

    def __init__(
        self,
        cvd: str,
        severity: float,
        simulation: str = "machado",
        strength: float = 1.0,
        seed: int = 0,
        budget: float | None = None,
        settings: FitSettings | None = None,
        starts: Sequence[SceneNetwork] = (),
        fitted: FittedNetwork | None = None,
    ) -> None:
        super().__init__(cvd, severity, simulation, strength, seed)
        if budget is not None and not 0.0 < budget < np.inf:  # also refuses NaN
            raise InputError(f"a budget of {budget:g} is out of range", remedy="give a mean ΔE00 above 0, e.g. 2")
        self._budget, self._settings, self._starts = budget, settings or FitSettings(), starts
        self._is_given, self._fitted = fitted is not None, fitted
        if fitted is not None:
            self._take(fitted)

    @classmethod
    def from_file(
        cls, path: Path, cvd: str, severity: float, simulation: str = "machado", strength: float = 1.0
    ) -> SceneNetworkEnhancer:
        """The enhancer that a run saved as ``layer.<layer>.safetensors``; nothing is fitted any more.

        Raises:
            InputError: the file cannot be used, or is for another observer.
        """
        fitted = load_network(path)
        made_for, asked = fitted.network.observer, Observer(cvd, severity, simulation)
        if severity > 0.0 and made_for != asked:
            remedy = f"pass --cvd {made_for.cvd} --severity {made_for.severity:g} --simulation {made_for.simulation}"
            what = f"the scene network is not for {cvd} vision of severity {severity:g} ({simulation})"
            raise InputError(what, where=path, remedy=remedy)
        return cls(cvd, severity, simulation, strength, fitted=fitted)

    @property
    def learns(self) -> bool:
        """See `SceneEnhancer.learns`."""
        return super().learns and not self._is_given

    @property
    def fitted(self) -> FittedNetwork:
        """The network at full strength; raises RuntimeError where `fit` has to come first."""
        if self._fitted is None:
            raise RuntimeError("fit the enhancer to the scene first")
        return self._fitted

    def save(self, path: Path) -> None:
        """Write the network as safetensors; `from_file` reads it."""
        save_network(self.fitted, path)

    def _fit(self, images: Images, reporter: Reporter, alphas: Alphas) -> None:
        if not self.learns:
            return
        self._take(
            fit_network(
                images,
                self._observer,
                alphas=alphas,
                budget=self._budget,
                starts=self._starts,
                settings=self._settings,
                seed=self._seed,
                reporter=reporter,
            )
        )

    def _take(self, fitted: FittedNetwork) -> None:
        self._fitted, self.lut = fitted, table_lut(fitted.table)

    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        result = np.empty(image.shape, np.float32)
        recolour(self.fitted.network, image, result, strength=self._strength)
        return result

    def enhance_bytes(self, image: NDArray, alpha: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
        """See `SceneEnhancer.enhance_bytes`; memory beyond the result's grows with a tile, not with the image."""
        if self.is_identity:
            return to_bytes(image)
        result = np.empty(image.shape, np.uint8)
        recolour(self.fitted.network, image, result, alpha, self._strength)
        return result
