"""The simulation S: what a person with a colour vision deficiency sees, differentiable.

S decodes sRGB, applies the model's matrices in linear light, clips to the gamut and encodes again. Gradients pass where
nothing was clipped. See `matrices` for the models and their sources.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import InputError
from .matrices import LinearSimulation, linear_simulation
from .spaces import apply_matrix, linear_to_lab, linear_to_srgb, srgb_to_linear

SIMULATION_SPACES = ("linear", "encoded")


@dataclass(frozen=True)
class Observer:
    """Somebody with a colour vision deficiency, and the model that simulates it; arguments of `simulate`."""

    cvd: str
    severity: float
    simulation: str = "machado"

    def simulate(self, image: Tensor) -> Tensor:
        """S(image) of a (..., 3, H, W) sRGB image."""
        return simulate(image, self.cvd, self.severity, self.simulation)

    def simulate_linear(self, linear: Tensor) -> Tensor:
        """S between (..., 3, H, W) linear sRGB images."""
        return simulate_linear(linear, self.cvd, self.severity, self.simulation)

    def lab(self, linear: Tensor) -> Tensor:
        """CIELAB of what the observer sees of (..., 3, H, W) linear sRGB."""
        return linear_to_lab(self.simulate_linear(linear))


def simulate(image: Tensor, cvd: str, severity: float, model: str = "machado", space: str = "linear") -> Tensor:
    """S(image): the image as seen with a colour vision deficiency.

    Args:
        image: (..., 3, H, W) display-referred sRGB in [0, 1], floating point.
        cvd: "protan", "deutan", "tritan" or "achromat".
        severity: 0 (normal vision; the image itself) to 1 (dichromacy or achromatopsia).
        model: "machado", "vienot" (protan, deutan) or "brettel".
        space: where the matrices apply: "linear" light, as the models define it, or the "encoded" values, as some
            papers do; only for comparison with those (mean ΔE00 of 5 to 6 from "linear").

    Returns:
        Tensor of the shape and type of `image`, in [0, 1].

    Raises:
        InputError: a combination that cannot be simulated.

    Example:
        >>> import torch
        >>> from cvdgs.core import simulate
        >>> brown_beside_green = torch.tensor([[[0.8, 0.4]], [[0.2, 0.5]], [[0.1, 0.1]]])
        >>> simulate(brown_beside_green, "deutan", 1.0)[0].round(decimals=2)  # their red: 0.8 and 0.4 before
        tensor([[0.5400, 0.5200]])
    """
    if space not in SIMULATION_SPACES:
        raise InputError(f"{space!r} is not a simulation space", remedy="use linear or encoded")
    simulation = linear_simulation(cvd, float(severity), model)
    if severity == 0.0:
        return image.clamp(0.0, 1.0)
    if space == "encoded":
        return _apply(simulation, image).clamp(0.0, 1.0)
    return linear_to_srgb(simulate_linear(srgb_to_linear(image), cvd, severity, model))


def simulate_linear(linear: Tensor, cvd: str, severity: float, model: str = "machado") -> Tensor:
    """S between linear images: (..., 3, H, W) linear sRGB to the same, clipped to [0, 1]; errors as for `simulate`."""
    return _apply(linear_simulation(cvd, float(severity), model), linear).clamp(0.0, 1.0)


def _apply(simulation: LinearSimulation, rgb: Tensor) -> Tensor:
    result = apply_matrix(simulation.matrix, rgb)
    if simulation.matrix_below is None or simulation.separator is None:
        return result
    separator = torch.as_tensor(simulation.separator, dtype=rgb.dtype, device=rgb.device)[:, None, None]
    above = (separator * rgb).sum(-3, keepdim=True) >= 0.0
    return torch.where(above, result, apply_matrix(simulation.matrix_below, rgb))
