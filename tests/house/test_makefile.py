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


def test_clean_leaves_weights_in_training_and_the_runs_of_users(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("weights", "chair", "demo", "bench"):
        (tmp_path / "out" / name).mkdir(parents=True)
    make("clean", folder=tmp_path)
    assert {place.name for place in (tmp_path / "out").iterdir()} == {"weights", "chair"}
