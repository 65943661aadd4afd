"""The built extension in a real Blender; skipped, with the reason, where none is given."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ..few_views import write_few_views
from .desktop import MISSING, PROGRAM, ROOT, Desktop

REPOSITORY = Path(__file__).resolve().parents[2]


def small_capture(share: Path) -> Path:
    """Half of the demo's views, a quarter as large, in place of what is there."""
    folder = share / "small"
    shutil.rmtree(folder, ignore_errors=True)
    return write_few_views(folder, 20, 0.25)


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


@pytest.fixture(scope="module")
def installed(desktop: Desktop, extension: Path):
    """The extension, installed in a Blender that has never seen it, and a capture of a few thumbnails."""
    shutil.copy(extension, desktop.share / extension.name)
    desktop.command("--command", "extension", "validate", f"/share/{extension.name}")
    desktop.command("--command", "extension", "install-file", "-r", "user_default", "-e", f"/share/{extension.name}")
    small_capture(desktop.share)
    (desktop.share / "nothing").mkdir(exist_ok=True)
    shutil.rmtree(desktop.share / "small CVD", ignore_errors=True)
    (desktop.share / "scene.blend").unlink(missing_ok=True)
    yield desktop
    desktop.quit()
    desktop.command("--command", "extension", "remove", "cvdgs")


@pytest.fixture(scope="session")
def finished_run(desktop: Desktop) -> str:
    """A finished run where the Blender finds it: that in CVDGS_FINISHED_RUN, for its looks, else a small one."""
    folder = desktop.share / "finished"
    shutil.rmtree(folder, ignore_errors=True)
    given = os.environ.get("CVDGS_FINISHED_RUN")
    if given:
        shutil.copytree(given, folder)
    else:
        small = small_capture(desktop.share)
        command = [sys.executable, REPOSITORY / "scripts" / "run.py", small, "--out", folder]
        subprocess.run([*command, "--no-blend", "--iterations", "300"], check=True)
    return "/share/finished"
