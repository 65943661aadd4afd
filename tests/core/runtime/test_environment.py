"""Making the worker's environment: from local packages, so that no test downloads anything."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.runs.folder import lock_exclusively, open_lock
from cvdgs.core.runtime.environment import is_complete, is_outdated, python_in, requirements


@pytest.fixture
def shelf(tmp_path: Path) -> Path:
    """A folder with one installable package, ``pebble`` 1.0."""
    folder = tmp_path / "shelf"
    folder.mkdir()
    with zipfile.ZipFile(folder / "pebble-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr("pebble.py", "WEIGHT = 3\n")
        wheel.writestr("pebble-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: pebble\nVersion: 1.0\n")
        wheel.writestr("pebble-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr("pebble-1.0.dist-info/RECORD", "")
    return folder


def make(folder: Path, shelf: Path, *packages: str) -> tuple[int, list[dict]]:
    """Exit code and events of the worker's job."""
    request = {"job": "make-environment", "folder": str(folder), "packages": list(packages)}
    result = subprocess.run(
        [sys.executable, ROOT / "core" / "__main__.py"],
        input=json.dumps(request) + "\n",
        env={**os.environ, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(shelf), "PIP_CONFIG_FILE": os.devnull},
        capture_output=True,
        text=True,
        timeout=120,
    )
    return result.returncode, [json.loads(line) for line in result.stdout.splitlines()]


def test_an_environment_has_what_was_asked_for(tmp_path, shelf):
    folder = tmp_path / "environment"
    code, events = make(folder, shelf, "pebble")
    assert code == 0
    assert is_complete(folder)
    assert events[-1]["python"] == str(python_in(folder))
    fractions = [event["fraction"] for event in events if event["event"] == "progress"]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    weight = subprocess.run([python_in(folder), "-c", "import pebble; print(pebble.WEIGHT)"], capture_output=True)
    assert weight.stdout.strip() == b"3"
    (folder / ".complete").write_text("pebble>=1\n")
    assert is_outdated(folder)
    assert not is_complete(folder)


def test_a_package_that_cannot_be_had_is_one_line_and_no_environment(tmp_path, shelf):
    folder = tmp_path / "environment"
    code, events = make(folder, shelf, "granite")
    assert code == 2
    assert not is_complete(folder)
    assert events[-1]["event"] == "error"
    assert "granite" in events[-1]["message"]
    assert "try again" in events[-1]["message"]


def test_an_environment_that_another_process_is_making_is_left_alone(tmp_path, shelf):
    folder = tmp_path / "environment"
    folder.mkdir()
    (folder / "half-made").touch()
    with open_lock(tmp_path / "environment.lock") as lock:
        lock_exclusively(lock)
        code, events = make(folder, shelf, "pebble")
    assert code == 2
    assert "is setting up the worker - wait for it" in events[-1]["message"]
    assert (folder / "half-made").exists()


def test_the_worker_requires_what_the_package_does():
    names = {requirement.split(">")[0].split("=")[0] for requirement in requirements()}
    assert {"torch", "warp-lang", "numpy", "pycolmap", "OpenImageIO"} <= names
    assert "bpy" not in names
