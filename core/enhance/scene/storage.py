"""Fitted scene networks on disk: safetensors with observer, budget and a checksum. Never a pickle."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor

from ...color.matrices import check_simulation
from ...color.simulation import Observer
from ...errors import InputError
from ...files.tensors import checksum, read_tensors, write_tensors
from .fit import FittedNetwork
from .network import SceneNetwork

FORMAT = "cvdgs-scene-network"
"""What the file's metadata call it."""

_VERSION = "1"  # of the network's code: raised when the same weights would give other images
_MAX_BYTES = 1 << 20  # larger files hold no scene network
_TABLE = "table_alone"
_REMEDY = "give a layer.*.safetensors of a run, or fit the scene again"


def save_network(fitted: FittedNetwork, path: Path) -> None:
    """Write what a fit gave; `load_network` reads it."""
    network, observer = fitted.network, fitted.network.observer
    tensors = {name: value.detach().contiguous() for name, value in network.state_dict().items()}
    tensors[_TABLE] = fitted.table.contiguous()
    metadata = {
        "format": FORMAT,
        "version": _VERSION,
        "cvd": observer.cvd,
        "severity": repr(float(observer.severity)),
        "simulation": observer.simulation,
        "budget": repr(float(fitted.budget)),
        "change": repr(float(fitted.change)),
        "sha256": checksum(tensors),
    }
    write_tensors(path, tensors, metadata)


def load_network(path: Path) -> FittedNetwork:
    """What `save_network` wrote.

    Raises:
        InputError: the file is missing, damaged, made by another version, or something else.
    """
    metadata, tensors = read_tensors(path, "the scene network", _REMEDY, most_bytes=_MAX_BYTES)
    if metadata.get("format") != FORMAT:
        raise InputError("the file holds no scene network", where=path, remedy=_REMEDY)
    if metadata.get("version") != _VERSION:
        found = metadata.get("version", "unknown")
        what = f"the scene network is of version {found}, this program reads version {_VERSION}"
        raise InputError(what, where=path, remedy="fit the scene again with this version")
    if checksum(tensors) != metadata.get("sha256"):
        raise InputError("the scene network is damaged (wrong checksum)", where=path, remedy=_REMEDY)
    try:
        return _fitted(metadata, tensors)
    except (KeyError, ValueError, RuntimeError, InputError):
        raise InputError("the scene network does not fit its description", where=path, remedy=_REMEDY) from None


def is_scene_network(path: Path) -> bool:
    """Whether a file says that it holds a scene network; what cannot be read says nothing."""
    try:
        metadata, _ = read_tensors(path, "the scene network", _REMEDY, most_bytes=_MAX_BYTES)
    except InputError:
        return False
    return metadata.get("format") == FORMAT


def _fitted(metadata: dict[str, str], tensors: dict[str, Tensor]) -> FittedNetwork:
    """Raises an error of `load_network`'s if values are missing, of the wrong shape or not finite."""
    observer = Observer(metadata["cvd"], float(metadata["severity"]), metadata["simulation"])
    check_simulation(observer.cvd, observer.severity, observer.simulation)
    budget, change = float(metadata["budget"]), float(metadata["change"])
    if not all(value.dtype == torch.float32 and torch.isfinite(value).all() for value in tensors.values()):
        raise ValueError("not finite numbers in single precision")
    if not (math.isfinite(budget) and math.isfinite(change)):
        raise ValueError("no finite budget")
    network = SceneNetwork(observer)
    table = tensors.pop(_TABLE)
    if table.shape != network.table.shape:
        raise ValueError("a table of another shape")
    network.load_state_dict(tensors)
    return FittedNetwork(network.requires_grad_(False), table, budget, change)
