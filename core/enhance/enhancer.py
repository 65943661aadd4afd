"""The protocol of what recolours views for an observer: fit to a scene, then call for each image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..color.matrices import check_simulation
from ..errors import InputError
from ..runtime.protocol import Reporter
from .lut import ColorLut, as_float
from .teacher import TeacherSettings, fit_lut


class Enhancer(Protocol):
    """Makes images easier to tell apart for one observer."""

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Take in the scene: its (H, W, 3) training views and, where they are not opaque, their (H, W) coverage."""

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """(H, W, 3) uint8, or float in [0, 1], to the enhanced (H, W, 3) float32 image in [0, 1]."""


class SceneIndependent:
    """The `fit` of enhancers that need to know nothing about a scene."""

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Nothing to learn."""


class IdentityEnhancer(SceneIndependent):
    """Leaves every image as it is: the control."""

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The image as float32."""
        return as_float(image)


class LutEnhancer:
    """Recolours with one LUT per scene, fitted by the teacher, so that all views agree.

    Args:
        cvd, severity, simulation: the observer, as for `simulate`.
        strength: 0 leaves the image as it is, 1 applies the fitted LUT in full.
        seed: of the fit.
        settings: constants of the fit; None for the defaults.

    At severity 0 or strength 0 there is nothing to fit and images are returned unchanged.
    """

    def __init__(
        self,
        cvd: str,
        severity: float,
        simulation: str = "machado",
        strength: float = 1.0,
        seed: int = 0,
        settings: TeacherSettings | None = None,
    ) -> None:
        check_simulation(cvd, severity, simulation)
        check_strength(strength)
        self._cvd, self._severity, self._simulation = cvd, severity, simulation
        self._strength, self._seed, self._settings = strength, seed, settings or TeacherSettings()
        self._lut: ColorLut | None = None

    @property
    def lut(self) -> ColorLut | None:
        """The fitted table at full strength; None before `fit` and where the enhancer is the identity."""
        return self._lut

    @property
    def is_identity(self) -> bool:
        """Whether images are returned unchanged."""
        return self._severity == 0.0 or self._strength == 0.0

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Fit the LUT to the training views; a few seconds on one core, whatever their number."""
        if self.is_identity:
            return
        self._lut = fit_lut(
            images,
            self._cvd,
            self._severity,
            self._simulation,
            alphas=alphas,
            settings=self._settings,
            seed=self._seed,
            reporter=reporter,
        )

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The recoloured image."""
        if self.is_identity:
            return as_float(image)
        if self._lut is None:
            raise RuntimeError("fit the enhancer to the scene before it is applied")
        return self._lut(image, self._strength)


def check_strength(strength: float) -> None:
    """Raise `InputError` unless the strength is in [0, 1]."""
    if not 0.0 <= strength <= 1.0:  # also refuses NaN
        raise InputError(f"strength {strength:g} is out of range", remedy="give a number from 0 to 1")
