"""The state of a training run in one safetensors file: networks, optimisers, step and settings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from ....core.errors import InputError
from ....core.files.tensors import read_tensors
from ....core.files.untrusted import explained, parse_json, replacing

_FORMAT = "cvdgs-enhancer-checkpoint"
_MAX_BYTES = 4 << 30  # networks of the largest shape that weights may have, and their optimisers
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
    with replacing(path) as temporary:
        save_file({name: value.detach().cpu().contiguous() for name, value in tensors.items()}, temporary, metadata)


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
        metadata, tensors = read_tensors(path, "the checkpoint", _REMEDY, most_bytes=_MAX_BYTES)
        if metadata.get("format") != _FORMAT:
            raise InputError("the file is not a training checkpoint", where=path, remedy=_REMEDY)
        _compare(dict(parse_json(metadata["settings"])), json.loads(json.dumps(settings)), path)
        for name, network in networks.items():
            prefix = f"network/{name}/"
            network.load_state_dict(
                {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}
            )
        for name, optimizer in optimizers.items():
            _restore(optimizer, f"optimizer/{name}/", tensors)
        return int(metadata["step"])
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"the checkpoint is damaged{explained(error)}", where=path, remedy=_REMEDY) from None


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
