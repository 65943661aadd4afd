"""For whom colours are judged: a kind and degree of colour vision, and the model that simulates it."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from .simulation import simulate_linear
from .spaces import linear_to_xyz, xyz_to_lab


@dataclass(frozen=True)
class Observer:
    """Arguments of `simulation.simulate`."""

    cvd: str
    severity: float
    simulation: str = "machado"

    def lab(self, linear: Tensor) -> Tensor:
        """CIELAB of what the observer sees of (..., 3, H, W) linear sRGB."""
        return xyz_to_lab(linear_to_xyz(simulate_linear(linear, self.cvd, self.severity, self.simulation)))
