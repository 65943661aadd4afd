"""The built extension in a real Blender; skipped, with the reason, where none is given."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from .desktop import MISSING, PROGRAM, ROOT, Desktop

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def extension(tmp_path_factory) -> Path:
    """The extension's zip."""
    folder = tmp_path_factory.mktemp("dist")
    builder = REPOSITORY / "scripts" / "build_extension.py"
    result = subprocess.run([sys.executable, builder, "--out", folder], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="session")
def pictures(tmp_path_factory) -> Path:
    """Where pictures of the screen are kept: CVDGS_PICTURES, else a temporary folder."""
    folder = Path(os.environ.get("CVDGS_PICTURES") or tmp_path_factory.mktemp("pictures"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def desktop(pictures: Path) -> Desktop:
    """The screen, with the worker's interpreter within reach of the Blender on it."""
    if not (PROGRAM and ROOT):
        pytest.skip(MISSING)
    prefix = subprocess.run(
        [sys.executable, "-c", "import sys; print(sys.base_prefix)"], capture_output=True, text=True, check=True
    )
    subprocess.run([PROGRAM, "bind", ROOT, prefix.stdout.strip(), sys.prefix], check=True)
    return Desktop(pictures)
