"""The shipped weights are used only when they are the very file that was published."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from cvdgs.core.enhance.gan.weights import (
    SHIPPED,
    checksum_file,
    load_shipped,
    save_generator,
    write_checksum,
)
from cvdgs.core.errors import InputError

from .networks import random_generator


@pytest.fixture
def shipped(tmp_path: Path) -> Path:
    """A copy of the shipped file and its checksum."""
    for path in (SHIPPED, checksum_file(SHIPPED)):
        shutil.copy(path, tmp_path)
    return tmp_path / SHIPPED.name


def test_the_shipped_file_is_the_published_one(shipped):
    load_shipped(shipped)
    card = SHIPPED.with_name("MODEL_CARD.md").read_text(encoding="utf-8")
    assert f"`{checksum_file(shipped).read_text().split()[0]}`" in card


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs sha256sum")
def test_the_checksum_can_be_checked_without_us(shipped):
    subprocess.run(["sha256sum", "--check", checksum_file(shipped).name], cwd=shipped.parent, check=True)


def test_another_file_that_is_whole_in_itself_is_refused_in_one_line(shipped):
    save_generator(random_generator(), shipped, {})
    with pytest.raises(InputError, match="not the file that was published") as refusal:
        load_shipped(shipped)
    assert "install cvdgs again" in str(refusal.value)
    write_checksum(shipped)
    load_shipped(shipped)


@pytest.mark.parametrize("part", [lambda path: path, checksum_file], ids=["weights", "checksum"])
def test_a_missing_part_is_refused(shipped, part):
    part(shipped).unlink()
    with pytest.raises(InputError, match="cannot be read"):
        load_shipped(shipped)
