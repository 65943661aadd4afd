"""The enhancers by name."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from ..color.matrices import check_simulation
from ..errors import InputError
from ..settings import ENHANCERS, PLUGIN_PREFIX, WEIGHTS_SUFFIX, Settings, is_enhancer
from .cgan import CganEnhancer
from .enhancer import Enhancer, IdentityEnhancer, LutEnhancer, check_strength
from .plugin import PluginEnhancer
from .scene.enhancer import SceneNetworkEnhancer
from .scene.storage import is_scene_network

PLUGIN_GROUP = "cvdgs.enhancers"
"""The group of entry points by which an installed package offers enhancers."""


def make_enhancer(
    name: str,
    cvd: str,
    severity: float,
    simulation: str = "machado",
    strength: float = 1.0,
    seed: int = 0,
    budget: float | None = None,
    fit_steps: int = Settings.fit,
) -> Enhancer:
    """The enhancer of this name or in a file, or a plug-in's, for an observer.

    A file holds a scene network, or weights of the conditional GAN; its metadata tell which.

    Args:
        budget: mean ΔE00 by which a scene network may change colours; None to take it from the photographs.
        fit_steps: by which the conditional GAN's prediction is fitted.

    Raises:
        InputError: an unknown enhancer, an observer that cannot be simulated, a strength outside [0, 1], weights that
            cannot be used, or a plug-in that is not installed or does not work.
    """
    if not is_enhancer(name):
        remedy = f"use {', '.join(ENHANCERS)} or a {WEIGHTS_SUFFIX} file"
        raise InputError(f"{name!r} is not an enhancer", where="--enhancer", remedy=remedy)
    check_simulation(cvd, severity, simulation)
    check_strength(strength)
    if name == IdentityEnhancer.name:
        return IdentityEnhancer()
    if name == LutEnhancer.name:
        return LutEnhancer(cvd, severity, simulation, strength, seed)
    if name.startswith(PLUGIN_PREFIX):
        return _plugin(name, cvd=cvd, severity=severity, simulation=simulation, strength=strength, seed=seed)
    if name == SceneNetworkEnhancer.name:
        return SceneNetworkEnhancer(cvd, severity, simulation, strength, seed, budget)
    if name != CganEnhancer.name and is_scene_network(Path(name)):
        return SceneNetworkEnhancer.from_file(Path(name), cvd, severity, simulation, strength)
    weights = None if name == CganEnhancer.name else Path(name)
    return CganEnhancer(cvd, severity, simulation, strength, seed, budget, weights, fit_steps)


def _plugin(name: str, **who: Any) -> Enhancer:
    """What an installed package offers under `name`, for an observer.

    A name finds nothing but what somebody has installed beside us on purpose: a batch file or a report that names an
    enhancer cannot make us import a module of its choice.
    """
    offered = entry_points(group=PLUGIN_GROUP)
    chosen = [point for point in offered if point.name == name.removeprefix(PLUGIN_PREFIX)]
    if not chosen:
        known = ", ".join(sorted(PLUGIN_PREFIX + point.name for point in offered)) or "none"
        remedy = f"install the package that offers it into the worker's environment (installed there: {known})"
        raise InputError(f"{name!r} is not installed", where="--enhancer", remedy=remedy)
    return PluginEnhancer(name, chosen[0].load, **who)
