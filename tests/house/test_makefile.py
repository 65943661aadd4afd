"""What the Makefile's targets would do, and what they leave alone."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="needs make")


def make(*arguments: str, folder: Path = ROOT) -> str:
    """What a `make` prints that knows nothing of one that runs these tests."""
    alone = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    return subprocess.run(
        ["make", *arguments], cwd=folder, env=alone, capture_output=True, text=True, check=True
    ).stdout


def python_3_13() -> str:
    """An interpreter itself, as a version manager's stand-in for it goes by the name it is called by; "" for none."""
    for found in (shutil.which("python3.13"), str(ROOT / ".venv-bpy52" / "bin" / "python")):
        if found and os.path.exists(found):
            asked = subprocess.run([found, "-c", "import sys; print(sys.executable)"], capture_output=True, text=True)
            if asked.returncode == 0:
                return os.path.realpath(asked.stdout.strip())
    return ""


def test_clean_leaves_weights_in_training_and_the_runs_of_users(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("weights", "chair", "demo", "bench"):
        (tmp_path / "out" / name).mkdir(parents=True)
    make("clean", folder=tmp_path)
    assert {place.name for place in (tmp_path / "out").iterdir()} == {"weights", "chair"}


@pytest.mark.skipif(not python_3_13(), reason="needs Python 3.13")
def test_an_environment_for_python_3_13_by_any_name_is_its_own_blender_5_2(tmp_path):
    (tmp_path / "python").symlink_to(python_3_13())
    planned = make("--dry-run", "test", f"PYTHON={tmp_path / 'python'}", f"PYTHON313={python_3_13()}")
    assert ".venv-bpy52" not in planned
