"""Weights on disk: safetensors with the network's shape, a checksum and where they come from. Never a pickle."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import torch
from safetensors import safe_open
from torch import nn

from ...errors import InputError
from ...files.tensors import checksum, read_tensors, write_tensors
from ...files.untrusted import parse_json
from .networks import Generator, GeneratorConfig

SHIPPED = Path(__file__).parent / "weights" / "enhancer.safetensors"
"""The weights that come with the repository; see the model card beside them."""

_FORMAT = "cvdgs-enhancer"
_VERSION = "7"  # of the network's code: raised when older weights would give other images or do not fit
_MAX_BYTES = 16 * 2**20  # larger files are no enhancer of ours


def save_generator(generator: Generator, path: Path, notes: dict[str, str] | None = None) -> None:
    """Write the weights, readable by `load_generator`.

    Args:
        notes: what else to keep with them, such as settings, seed and date.
    """
    tensors = {name: value.detach().cpu().contiguous() for name, value in generator.state_dict().items()}
    metadata = {
        **(notes or {}),
        "format": _FORMAT,
        "version": _VERSION,
        "config": json.dumps(generator.config.to_dict()),
        "sha256": checksum(tensors),
    }
    write_tensors(path, tensors, metadata)


def load_generator(path: Path) -> Generator:
    """The generator of a file, ready to be applied.

    Raises:
        InputError: the file is missing, damaged, made by another version, or something else.
    """
    metadata, tensors = read_tensors(path, "the enhancer's weights", _REMEDY, most_bytes=_MAX_BYTES)
    _check_header(metadata, path)
    if not all(value.dtype == torch.float32 for value in tensors.values()):
        raise InputError("the enhancer's weights are not in single precision", where=path, remedy=_REMEDY)
    if checksum(tensors) != metadata.get("sha256"):
        raise InputError("the enhancer's weights are damaged (wrong checksum)", where=path, remedy=_REMEDY)
    if not all(torch.isfinite(value).all() for value in tensors.values()):
        raise InputError("the enhancer's weights are not all finite", where=path, remedy=_REMEDY)
    try:
        config = GeneratorConfig.from_dict(parse_json(metadata["config"]))
        if _shapes(Generator, config) != {name: value.shape for name, value in tensors.items()}:
            raise ValueError("other shapes")
        generator = Generator(config)
        generator.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, RuntimeError):
        raise InputError("the weights do not fit the network they describe", where=path, remedy=_REMEDY) from None
    return generator.eval().requires_grad_(False)


def read_notes(path: Path) -> dict[str, str]:
    """What `save_generator` was told to keep; the file is one that `load_generator` takes."""
    with safe_open(path, framework="pt") as file:
        return dict(file.metadata() or {})


_REMEDY = "give a file that scripts/train_enhancer.py made, or use --enhancer cgan for the shipped one"


def _check_header(metadata: dict[str, str], path: Path) -> None:
    if metadata.get("format") != _FORMAT:
        raise InputError("the file does not contain enhancer weights", where=path, remedy=_REMEDY)
    if metadata.get("version") != _VERSION:
        found = metadata.get("version", "unknown")
        raise InputError(
            f"the weights have version {found}, this program reads version {_VERSION}",
            where=path,
            remedy="train them again with this version's scripts/train_enhancer.py",
        )


def _shapes(network: Callable[[GeneratorConfig], nn.Module], config: GeneratorConfig) -> dict[str, torch.Size]:
    """Of the weights that a network of `config` has, found out without room for them."""
    with torch.device("meta"):
        return {name: value.shape for name, value in network(config).state_dict().items()}


_REINSTALL = "install cvdgs again, or give your own weights as a file: --enhancer FILE.safetensors"


def checksum_file(weights: Path) -> Path:
    """Where the checksum of `weights` stands; in the format of sha256sum, which checks it with -c."""
    return weights.with_name(weights.name + ".sha256")


def write_checksum(weights: Path) -> None:
    """Write the checksum of `weights` beside them."""
    line = f"{hashlib.sha256(weights.read_bytes()).hexdigest()}  {weights.name}\n"
    checksum_file(weights).write_text(line, encoding="utf-8")


def load_shipped(weights: Path = SHIPPED) -> Generator:
    """The published generator, ready to be applied.

    Raises:
        InputError: file or checksum is missing, or they do not belong together.
    """
    try:
        published = checksum_file(weights).read_text(encoding="utf-8").split()
        found = hashlib.sha256(weights.read_bytes()).hexdigest()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise InputError(f"the shipped weights cannot be read ({reason})", where=weights, remedy=_REINSTALL) from None
    if published != [found, weights.name]:
        raise InputError("is not the file that was published (wrong checksum)", where=weights, remedy=_REINSTALL)
    return load_generator(weights)
