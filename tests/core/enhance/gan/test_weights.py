"""Weights come back as they were saved; anything else is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from cvdgs.core.enhance.gan.weights import SHIPPED, load_generator, save_generator
from cvdgs.core.errors import InputError

from .networks import SMALL, random_generator


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "enhancer.safetensors"
    save_generator(random_generator(), path, {"date": "2026-11-21"})
    return path


def rewritten(path: Path, tensors: dict | None = None, **metadata: str) -> Path:
    with safe_open(path, framework="pt") as file:
        values = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        header = file.metadata()
    save_file(values | (tensors or {}), path, {**header, **metadata})
    return path


def test_weights_come_back_as_they_were(saved):
    original, loaded = random_generator(), load_generator(saved)
    assert loaded.config == SMALL
    assert all(torch.equal(a, b) for a, b in zip(original.parameters(), loaded.parameters(), strict=True))


def test_a_flipped_bit_is_noticed(saved):
    content = bytearray(saved.read_bytes())
    content[-3] ^= 16
    saved.write_bytes(content)
    with pytest.raises(InputError, match=r"damaged.*checksum"):
        load_generator(saved)


def test_a_truncated_file_is_refused(saved):
    saved.write_bytes(saved.read_bytes()[:-100])
    with pytest.raises(InputError, match="cannot be read"):
        load_generator(saved)


def test_weights_of_another_version_are_refused(saved):
    with pytest.raises(InputError, match=r"version 99.*train them again"):
        load_generator(rewritten(saved, version="99"))


def test_weights_of_something_else_are_refused(saved):
    with pytest.raises(InputError, match="does not contain enhancer weights"):
        load_generator(rewritten(saved, format="cvdgs-color-lut"))


def test_weights_of_the_network_that_refined_a_lut_are_refused(saved):
    with pytest.raises(InputError, match=r"version 2, this program reads version \d.*train them again"):
        load_generator(rewritten(saved, version="2"))


@pytest.mark.parametrize(
    "config",
    [
        "",
        "[]",
        "{}",
        '{"widths": [1]}',
        '{"widths": [100000, 2, 2, 2], "attentions": 1, "embedding": 1, "code": 1}',
        '{"widths": [4, 6, 8, 8], "attentions": 3, "embedding": 8, "code": "6"}',
    ],
)
def test_an_impossible_shape_is_refused(saved, config):
    with pytest.raises(InputError, match="do not fit"):
        load_generator(rewritten(saved, config=config))


def test_a_shape_that_the_weights_do_not_have_is_refused(saved):
    with pytest.raises(InputError, match="do not fit"):
        load_generator(rewritten(saved, config=json.dumps({**SMALL.to_dict(), "widths": [4, 6, 8, 9]})))


def test_weights_that_are_not_finite_are_refused(tmp_path):
    generator = random_generator()
    generator.share.weight[0, 0] = float("nan")
    save_generator(generator, tmp_path / "bad.safetensors")
    with pytest.raises(InputError, match="not all finite"):
        load_generator(tmp_path / "bad.safetensors")


def test_a_pickle_is_refused_and_not_run(tmp_path):
    torch.save(random_generator().state_dict(), tmp_path / "enhancer.safetensors")
    with pytest.raises(InputError, match="cannot be read"):
        load_generator(tmp_path / "enhancer.safetensors")


def test_the_shipped_weights_can_be_loaded_and_are_small():
    load_generator(SHIPPED)
    assert SHIPPED.stat().st_size <= 2 * 10**6
