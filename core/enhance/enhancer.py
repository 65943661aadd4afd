"""What recolours views for an observer: the protocol, the base of those that are fitted to a scene, and the LUT's."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ..color.matrices import check_simulation
from ..color.simulation import Observer
from ..errors import InputError
from ..files.images import to_bytes
from ..runtime.protocol import Reporter
from .lut import ColorLut, as_float
from .lut_fit import LutSettings, fit_lut
from .pairs import Alphas, Images


class Enhancer(Protocol):
    """Makes images easier to tell apart for one observer: what a plug-in provides."""

    def fit(self, images: Images, reporter: Reporter | None = None, *, alphas: Alphas = None) -> None:
        """Adapt to the scene, given its (H, W, 3) training views and, where they are not opaque, (H, W) coverage."""

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """(H, W, 3) uint8, or float in [0, 1], to the enhanced (H, W, 3) float32 image in [0, 1]."""


class SceneEnhancer(ABC):
    """Base of the enhancers for one observer that are fitted once to a scene, so that all its views agree.

    Args:
        cvd, severity, simulation: the observer, as for `simulate`.
        strength: 0 leaves the image as it is, 1 applies the change in full.
        seed: of the fit.

    At severity 0 or strength 0 there is nothing to fit, and images are returned unchanged.

    Raises:
        InputError: an observer that cannot be simulated, or a strength outside [0, 1].
    """

    name: ClassVar[str]
    """What `--enhancer` calls it."""

    lut: ColorLut | None = None
    """The scene's LUT at full strength; None before `fit`, and where the enhancer has none."""

    def __init__(
        self, cvd: str, severity: float, simulation: str = "machado", strength: float = 1.0, seed: int = 0
    ) -> None:
        check_simulation(cvd, severity, simulation)
        check_strength(strength)
        self._observer, self._strength, self._seed = Observer(cvd, severity, simulation), strength, seed

    @property
    def is_identity(self) -> bool:
        """Whether images are returned unchanged."""
        return self._observer.severity == 0.0 or self._strength == 0.0

    @property
    def learns(self) -> bool:
        """Whether `fit` has anything to do."""
        return not self.is_identity

    def fit(self, images: Images, reporter: Reporter | None = None, *, alphas: Alphas = None) -> None:
        """See `Enhancer.fit`."""
        if not self.is_identity:
            self._fit(images, reporter or Reporter(), alphas)

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """See `Enhancer.__call__`; raises RuntimeError where `fit` has to come first."""
        return as_float(image) if self.is_identity else self._enhance(image)

    def enhance_bytes(self, image: NDArray, alpha: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
        """The enhanced (H, W, 3) image in 8 bits.

        Args:
            alpha: (H, W) coverage, for enhancers that look at a pixel's surroundings.
        """
        return to_bytes(self(image))

    def save(self, path: Path) -> None:
        """Write the scene's LUT as safetensors; `ColorLut.load` reads it."""
        self._fitted_lut().save(path)

    def export_cube(self, path: Path, title: str) -> None:
        """Write the scene's LUT as a `.cube` file at the enhancer's strength, for grading tools."""
        self._fitted_lut().export_cube(path, strength=self._strength, title=title)

    def _fitted_lut(self) -> ColorLut:
        if self.lut is None:
            raise RuntimeError("fit the enhancer to the scene first")
        return self.lut

    def _fit(self, images: Images, reporter: Reporter, alphas: Alphas) -> None:  # noqa: B027 - some learn nothing
        """Adapt to the scene."""

    @abstractmethod
    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        """The recoloured image."""


class IdentityEnhancer(SceneEnhancer):
    """Leaves every image as it is: the control."""

    name = "none"

    def __init__(self) -> None:
        super().__init__("deutan", severity=0.0)  # severity 0 is normal vision, whatever the type

    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        return as_float(image)


class LutEnhancer(SceneEnhancer):
    """Recolours with one LUT per scene, fitted in a few seconds on one core.

    Args:
        settings: constants of the fit; None for the defaults.
    """

    name = "lut"

    def __init__(
        self,
        cvd: str,
        severity: float,
        simulation: str = "machado",
        strength: float = 1.0,
        seed: int = 0,
        settings: LutSettings | None = None,
    ) -> None:
        super().__init__(cvd, severity, simulation, strength, seed)
        self._settings = settings or LutSettings()

    def _fit(self, images: Images, reporter: Reporter, alphas: Alphas) -> None:
        who = (self._observer.cvd, self._observer.severity, self._observer.simulation)
        self.lut = fit_lut(images, *who, alphas=alphas, settings=self._settings, seed=self._seed, reporter=reporter)

    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        return self._fitted_lut()(image, self._strength)


def enhance_bytes(enhancer: Enhancer, image: NDArray, alpha: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
    """`SceneEnhancer.enhance_bytes` of any enhancer; a plug-in's is not told the coverage."""
    return enhance_finite(enhancer, image, alpha)[0]


def enhance_finite(
    enhancer: Enhancer, image: NDArray, alpha: NDArray[np.uint8] | None = None
) -> tuple[NDArray[np.uint8], int]:
    """`enhance_bytes`, and the number of pixels that a plug-in gave no finite colour: these stay as they are."""
    if isinstance(enhancer, SceneEnhancer):
        return enhancer.enhance_bytes(image, alpha), 0
    enhanced = np.asarray(enhancer(image))
    broken = ~np.isfinite(enhanced).all(axis=-1)
    if not broken.any():
        return to_bytes(enhanced), 0
    return to_bytes(np.where(broken[..., None], as_float(image), enhanced)), int(broken.sum())


def learns(enhancer: Enhancer) -> bool:
    """`SceneEnhancer.learns` of any enhancer; a plug-in may."""
    return not isinstance(enhancer, SceneEnhancer) or enhancer.learns


def warn_not_finite(reporter: Reporter, where: str, pixels: int) -> None:
    """Say in how many `pixels` of `where` the enhancer gave no finite colour, if in any."""
    if pixels:
        found = f"{where}: the enhancer gave no finite colour for {pixels:,} pixels"
        remedy = "which stay as photographed; ask its authors, or use another --enhancer"
        reporter.warning("enhancer-not-finite", f"{found}, {remedy}")


def check_strength(strength: float) -> None:
    """Raise `InputError` unless the strength is in [0, 1]."""
    if not 0.0 <= strength <= 1.0:  # also refuses NaN
        raise InputError(f"strength {strength:g} is out of range", remedy="give a number from 0 to 1")
