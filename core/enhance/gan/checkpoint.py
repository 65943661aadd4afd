"""The state of a training run in one safetensors file: networks, optimisers, step and settings."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from ...errors import InputError

_FORMAT = "cvdgs-enhancer-checkpoint"
_REMEDY = "train into another folder, or remove this file"


def save_checkpoint(
    path: Path,
    networks: Mapping[str, nn.Module],
    optimizers: Mapping[str, torch.optim.Optimizer],
    step: int,
    settings: dict[str, Any],
) -> None:
    """Write the state; an earlier file is replaced only when the new one is whole."""
    tensors: dict[str, Tensor] = {}
    for name, network in networks.items():
        tensors |= {f"network/{name}/{key}": value for key, value in network.state_dict().items()}
    for name, optimizer in optimizers.items():
        for index, state in optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer/{name}/{index}/{key}": torch.as_tensor(value) for key, value in state.items()}
    metadata = {"format": _FORMAT, "step": str(step), "settings": json.dumps(settings)}
    partial = path.with_suffix(".partial")
    save_file({name: value.detach().cpu().contiguous() for name, value in tensors.items()}, partial, metadata)
    os.replace(partial, path)


def load_checkpoint(
    path: Path,
    networks: Mapping[str, nn.Module],
    optimizers: Mapping[str, torch.optim.Optimizer],
    settings: dict[str, Any],
) -> int:
    """Restore what `save_checkpoint` wrote; returns the step.

    Raises:
        InputError: the file is damaged, or its settings differ in more than the number of steps.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no dictionary
        if metadata.get("format") != _FORMAT:
            raise InputError("the file is no checkpoint of a training", where=path, remedy=_REMEDY)
        _compare(json.loads(metadata["settings"]), json.loads(json.dumps(settings)), path)
        for name, network in networks.items():
            prefix = f"network/{name}/"
            network.load_state_dict(
                {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}
            )
        for name, optimizer in optimizers.items():
            _restore(optimizer, f"optimizer/{name}/", tensors)
        return int(metadata["step"])
    except (OSError, SafetensorError, KeyError, ValueError, RuntimeError) as error:
        what = str(error).splitlines()[0]
        raise InputError(f"the checkpoint cannot be read ({what})", where=path, remedy=_REMEDY) from None


def _compare(stored: dict[str, Any], asked: dict[str, Any], path: Path) -> None:
    differing = sorted(key for key in {*stored, *asked} - {"steps"} if stored.get(key) != asked.get(key))
    if differing:
        raise InputError(
            f"the run was started with other settings ({', '.join(differing)})", where=path, remedy=_REMEDY
        )


def _restore(optimizer: torch.optim.Optimizer, prefix: str, tensors: Mapping[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith(prefix):
            index, key = name.removeprefix(prefix).split("/")
            state.setdefault(int(index), {})[key] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
