"""The commands, started by a Blender that has the extension enabled: its classes and theirs get on with each other."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import REPOSITORY, small_capture
from .desktop import PROGRAM, ROOT, Desktop

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

SCRIPTS = ("run.py", "turntable.py", "enhance.py")


@pytest.fixture(scope="module")
def within_reach(installed: Desktop) -> Desktop:
    """The checkout, where the Blender finds it, and a small capture."""
    subprocess.run([PROGRAM, "bind", ROOT, REPOSITORY], check=True)
    small_capture(installed.share)
    return installed


def start(script: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Let Blender run one of the scripts, by this interpreter's workers."""
    command = [PROGRAM, "run", ROOT, "-b", "-P", REPOSITORY / "scripts" / script, "--", *arguments]
    environment = {**os.environ, "BLENV": f"CVDGS_PYTHON={sys.executable}"}
    result = subprocess.run(command, capture_output=True, text=True, timeout=900, env=environment)
    assert "Traceback" not in result.stdout + result.stderr, result.stderr
    assert "Exception" not in result.stdout + result.stderr, result.stderr
    return result


@pytest.mark.parametrize("script", SCRIPTS)
def test_what_a_script_refuses_is_one_line(within_reach: Desktop, script: str):
    result = start(script, "/share/nowhere", "--out", "/share/scripted")
    assert result.returncode == 2
    said = [line for line in result.stderr.splitlines() if "/share/nowhere" in line]
    assert len(said) == 1, result.stderr


def test_a_run_and_its_turntable_and_enhanced_photographs_are_made(within_reach: Desktop):
    for name in ("scripted", "scripted photographs"):
        shutil.rmtree(within_reach.share / name, ignore_errors=True)
    settings = ("--iterations", "60", "--max-size", "80", "--turntable", "2")
    made = start("run.py", "/share/small", "--out", "/share/scripted", *settings)
    assert made.returncode == 0, made.stderr
    assert (within_reach.share / "scripted" / "scene.blend").is_file()
    assert len(list((within_reach.share / "scripted" / "turntable").glob("*/*.png"))) >= 2
    made = start("enhance.py", "/share/small/images", "--out", "/share/scripted photographs")
    assert made.returncode == 0, made.stderr
    made = start("turntable.py", "--example", "/share/batch.toml")
    assert made.returncode == 0, made.stderr
