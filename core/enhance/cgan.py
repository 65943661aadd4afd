"""The enhancer that is trained beforehand: a conditional GAN that improves on the scene's LUT, view by view."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..color.spaces import image_to_tensor, tensor_to_image
from ..runtime.protocol import Reporter
from .enhancer import SceneEnhancer
from .gan.apply import average_statistics, enhance, record_statistics
from .gan.conditioning import palette
from .gan.networks import Statistics
from .gan.weights import load_generator, load_shipped
from .pairs import Alphas, Images
from .teacher import fit_luts

_SCENE_VIEWS = 16
"""Views, spread over the scene, from which a normalised network takes its statistics, to bound the time."""


class CganEnhancer(SceneEnhancer):
    """Recolours with one LUT per scene, then with a U-Net that sees the view and the LUT's proposal.

    Views agree because the LUT and the network's conditions are taken from all of them together.

    Args:
        weights: a file of `gan.weights`; None for the shipped one.
        device: of torch: "cpu" or "cuda".

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
        weights: Path | None = None,
        device: str = "cpu",
    ) -> None:
        super().__init__(cvd, severity, simulation, strength, seed)
        self._device = device
        self._generator = (load_generator(weights) if weights else load_shipped()).to(device)
        self._palette = torch.empty(0)
        self._statistics: Statistics | None = None

    def _fit(self, images: Images, reporter: Reporter, alphas: Alphas) -> None:
        """Fit the LUT and take the scene's palette, and for a network with `scene` normalisation its statistics."""
        (self.lut,) = fit_luts(images, [self._observer], alphas=alphas, seed=self._seed, reporter=reporter)
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

    def _enhance(self, image: NDArray) -> NDArray[np.float32]:
        pair = self._tensors(image)
        enhanced = enhance(self._generator, *pair, self._observer, self._palette, self._statistics, self._strength)
        return tensor_to_image(enhanced)

    def _tensors(self, image: NDArray) -> tuple[Tensor, Tensor]:
        """The image and the LUT's proposal, (3, H, W) on the device."""
        proposal = self._fitted_lut()(image)
        return image_to_tensor(image).to(self._device), image_to_tensor(proposal).to(self._device)
