"""Blender's side, tested in process with whichever bpy wheel this environment has; skipped where there is none."""

from __future__ import annotations

import importlib.util
import runpy
from pathlib import Path

import pytest

if importlib.util.find_spec("bpy") is None:
    collect_ignore_glob = ["test_*.py"]
else:
    import bpy

    if importlib.util.find_spec("cvdgs") is None:  # an environment that has bpy and little else
        bootstrap = Path(__file__).resolve().parents[2] / "core" / "bootstrap.py"
        runpy.run_path(str(bootstrap))["load"]()

    import cvdgs

    from .interpreters import interpreter
    from .scenes import synthetic_run


@pytest.fixture
def scene():
    """The scene of a new, empty file that is set up to show Gaussians on black as they were trained."""
    from cvdgs.cvdgs_addon.scene import render_settings

    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    render_settings.set_cycles(scene)
    render_settings.set_display(scene, render_settings.Display.PHOTO)
    render_settings.set_background(scene, (0.0, 0.0, 0.0))
    render_settings.set_png(scene)
    return scene


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """A finished run of a small synthetic scene with the layers deutan-1.0 and tritan-0.5."""
    return synthetic_run(tmp_path / "run")


@pytest.fixture
def addon(tmp_path: Path):
    """The add-on, enabled in an empty file; its preferences."""
    bpy.ops.wm.read_homefile(use_empty=True)
    entry = bpy.context.preferences.addons.new()
    entry.module = "cvdgs"
    cvdgs.register()
    entry.preferences.cache = str(tmp_path / "cache")
    yield entry.preferences
    cvdgs.unregister()
    bpy.context.preferences.addons.remove(entry)


@pytest.fixture
def capture(tmp_path: Path, addon):
    """A scene whose capture was inspected."""
    scene = bpy.context.scene
    scene.cvdgs.capture.folder = scene.cvdgs.capture.inspected = str(tmp_path / "photos")
    scene.cvdgs.capture.views, scene.cvdgs.capture.width, scene.cvdgs.capture.height = 24, 480, 360
    return scene


@pytest.fixture
def worker(tmp_path: Path, monkeypatch):
    """Lets a program that does what it is given take the place of the worker's Python."""

    def use(*bodies: str) -> None:
        monkeypatch.setenv("CVDGS_PYTHON", interpreter(tmp_path, *bodies))

    return use
