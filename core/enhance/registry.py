"""The enhancers by name."""

from __future__ import annotations

from pathlib import Path

from ..color.matrices import check_simulation
from ..errors import InputError
from ..settings import ENHANCERS, WEIGHTS_SUFFIX, is_enhancer
from .cgan import CganEnhancer
from .enhancer import Enhancer, IdentityEnhancer, LutEnhancer, check_strength


def make_enhancer(
    name: str,
    cvd: str,
    severity: float,
    simulation: str = "machado",
    strength: float = 1.0,
    seed: int = 0,
    device: str = "cpu",
) -> Enhancer:
    """The enhancer of this name, or the conditional GAN with the weights of a file, for an observer.

    Raises:
        InputError: an unknown enhancer, an observer that cannot be simulated, a strength outside [0, 1], or weights
            that cannot be used.
    """
    if not is_enhancer(name):
        remedy = f"use {', '.join(ENHANCERS)} or a {WEIGHTS_SUFFIX} file"
        raise InputError(f"{name!r} is not an enhancer", where="--enhancer", remedy=remedy)
    check_simulation(cvd, severity, simulation)
    check_strength(strength)
    if name == "none":
        return IdentityEnhancer()
    if name == "lut":
        return LutEnhancer(cvd, severity, simulation, strength, seed)
    weights = None if name == "cgan" else Path(name)
    return CganEnhancer(cvd, severity, simulation, strength, seed, weights, device)
