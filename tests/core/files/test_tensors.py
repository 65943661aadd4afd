"""Tensors are written as safetensors that its own library reads, and in one way."""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors import safe_open

from cvdgs.core.files.tensors import read_tensors, write_tensors

TENSORS = {"weight": torch.arange(6.0).reshape(2, 3), "steps": torch.tensor([3], dtype=torch.int64)}
METADATA = {name: name.upper() for name in ("format", "cvd", "severity", "simulation", "budget", "change", "Grün")}


def test_the_same_content_is_written_as_the_same_bytes(tmp_path: Path) -> None:
    written = set()
    for order in (METADATA, dict(reversed(METADATA.items()))):
        for number in range(5):
            write_tensors(tmp_path / f"{number}.safetensors", TENSORS, order)
            written.add((tmp_path / f"{number}.safetensors").read_bytes())
    assert len(written) == 1


def test_what_is_written_is_read_by_the_library_and_by_us(tmp_path: Path) -> None:
    path = tmp_path / "one.safetensors"
    write_tensors(path, TENSORS, METADATA)
    with safe_open(path, framework="pt") as file:
        assert file.metadata() == METADATA
        assert set(file.keys()) == set(TENSORS)
        for name, tensor in TENSORS.items():
            assert torch.equal(file.get_tensor(name), tensor)
    metadata, tensors = read_tensors(path, "a test", "none", most_bytes=1 << 20)
    assert metadata == METADATA
    assert all(torch.equal(tensors[name], tensor) for name, tensor in TENSORS.items())
