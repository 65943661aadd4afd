"""What several tests of the core put in the place of other programs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest


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
