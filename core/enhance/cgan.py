"""The enhancer that is trained beforehand: a conditional GAN that improves on the scene's LUT, view by view."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..color.matrices import check_simulation
from ..color.simulation import Observer
from ..color.spaces import image_to_tensor, tensor_to_image
from ..runtime.protocol import Reporter
from .enhancer import LutEnhancer, check_strength
from .gan.apply import average_statistics, enhance, record_statistics
from .gan.conditioning import palette
from .gan.networks import Statistics
from .gan.weights import load_generator, load_shipped
from .lut import ColorLut, as_float

_SCENE_VIEWS = 16
"""Views, spread over the scene, from which a normalised network takes its statistics, to bound the time."""


class CganEnhancer:
    """Recolours with one LUT per scene, then with a U-Net that sees the view and the LUT's proposal.

    Views agree because the LUT, and what steers the network, are taken from all of them together.

    Args:
        cvd, severity, simulation: the observer, as for `simulate`.
        strength: 0 leaves the image as it is, 1 applies the change in full.
        seed: of the LUT's fit.
        weights: a file of `gan.weights`; None for the shipped one.
        device: of torch: "cpu" or "cuda".

    At severity 0 or strength 0 images are returned unchanged.

    Raises:
        InputError: an observer that cannot be simulated, or weights that cannot be used.
    """

    def __init__(
        self,
        cvd: str,
        severity: float,
        simulation: str = "machado",
        strength: float = 1.0,
        seed: int = 0,
        weights: Path | None = None,
        device: str = "cpu",
    ) -> None:
        check_simulation(cvd, severity, simulation)
        check_strength(strength)
        self._observer, self._strength, self._device = Observer(cvd, severity, simulation), strength, device
        self._generator = (load_generator(weights) if weights else load_shipped()).to(device)
        self._proposer = LutEnhancer(cvd, severity, simulation, seed=seed)
        self._palette: Tensor | None = None
        self._statistics: Statistics | None = None

    @property
    def lut(self) -> ColorLut | None:
        """The scene's LUT that the network starts from; None before `fit` and where the enhancer is the identity."""
        return self._proposer.lut

    @property
    def is_identity(self) -> bool:
        """Whether images are returned unchanged."""
        return self._observer.severity == 0.0 or self._strength == 0.0

    def fit(
        self,
        images: Sequence[NDArray[np.uint8]],
        reporter: Reporter | None = None,
        *,
        alphas: Sequence[NDArray[np.uint8] | None] | None = None,
    ) -> None:
        """Fit the LUT and take the scene's palette, and for a network with `scene` normalisation its statistics."""
        if self.is_identity:
            return
        self._proposer.fit(images, reporter, alphas=alphas)
        self._palette = palette(images, alphas)
        if self._generator.config.normalisation != "scene":
            return
        chosen = np.unique(np.linspace(0, len(images) - 1, min(len(images), _SCENE_VIEWS)).round().astype(int))
        self._statistics = average_statistics(
            [
                record_statistics(self._generator, *self._tensors(images[i]), self._observer, self._palette)
                for i in chosen
            ]
        )

    def __call__(self, image: NDArray) -> NDArray[np.float32]:
        """The recoloured image."""
        if self.is_identity:
            return as_float(image)
        if self._palette is None:
            raise RuntimeError("fit the enhancer to the scene before it is applied")
        enhanced = enhance(
            self._generator, *self._tensors(image), self._observer, self._palette, self._statistics, self._strength
        )
        return tensor_to_image(enhanced)

    def _tensors(self, image: NDArray) -> tuple[Tensor, Tensor]:
        """The image and the LUT's proposal, (3, H, W) on the device."""
        with torch.no_grad():
            image_tensor, proposal = (image_to_tensor(x).to(self._device) for x in (image, self._proposer(image)))
        return image_tensor, proposal
