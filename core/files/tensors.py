"""Tensors in safetensors files, of which somebody else may have made those that are read. Never a pickle."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from ..errors import InputError
from .untrusted import opened


def read_tensors(path: Path, what: str, remedy: str, *, most_bytes: int) -> tuple[dict[str, str], dict[str, Tensor]]:
    """The metadata and the tensors of a file, by name.

    Args:
        what: the file holds, for the message.
        remedy: what the user can do where it does not.
        most_bytes: that the file may have; the tensors have no more than that.

    Raises:
        InputError: no regular file, too large, no safetensors, damaged, or of a type that torch does not have.
    """
    with opened(path, most_bytes=most_bytes, remedy=remedy):
        pass  # safetensors opens it itself, and would wait for a pipe
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no dictionary
            return file.metadata() or {}, tensors
    except (SafetensorError, OSError, RuntimeError, ValueError, TypeError, AttributeError, KeyError) as error:
        raise InputError(f"{what} cannot be read ({error})", where=path, remedy=remedy) from None


def write_tensors(path: Path, tensors: dict[str, Tensor], metadata: dict[str, str]) -> None:
    """Write a safetensors file: the same bytes for the same content, where the library shuffles the metadata."""
    saved = save(tensors, metadata)
    end = 8 + int.from_bytes(saved[:8], "little")  # the header is JSON, whose length comes before it
    header = {**json.loads(saved[8:end]), "__metadata__": dict(sorted(metadata.items()))}
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)  # as the library aligns it
    path.write_bytes(len(text).to_bytes(8, "little") + text + saved[end:])


def checksum(tensors: dict[str, Tensor]) -> str:
    """SHA-256 over names, types, shapes and values, as hexadecimal digits."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        value = tensors[name].contiguous()
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}\n".encode())
        digest.update(value.view(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()
