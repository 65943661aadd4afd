"""What several tests of the core put in the place of other programs."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from cvdgs.core.runtime.resources import CARDS_VARIABLE

NVIDIA_SMI = """\
#!/bin/sh
echo 'GPU 0: NVIDIA T4 (UUID: GPU-aa11)'
echo 'GPU 1: NVIDIA T4 (UUID: GPU-bb22)'
"""


@pytest.fixture
def as_blender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Puts a program, given as text, in Blender's place; returns its folder."""

    def place(program: str) -> Path:
        folder = tmp_path / "program"
        folder.mkdir()
        (folder / "blender").write_text(program)
        (folder / "blender").chmod(0o755)
        monkeypatch.setenv("CVDGS_BLENDER", str(folder / "blender"))
        return folder

    return place


@pytest.fixture
def two_cards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver that lists two graphics cards, all of which may be used."""
    program = tmp_path / "driver" / "nvidia-smi"
    program.parent.mkdir()
    program.write_text(NVIDIA_SMI)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    monkeypatch.delenv(CARDS_VARIABLE, raising=False)
