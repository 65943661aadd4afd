"""The package as Blender loads it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cvdgs
from cvdgs.core import bootstrap
from cvdgs.cvdgs_addon import scene

from .interpreters import SLEEPING, interpreter

HEAVY = ("torch", "warp", "pycolmap", "OpenImageIO", "kornia", "colour", "plyfile", "scipy")


def test_registering_ten_times_in_a_row_works():
    for _ in range(10):
        cvdgs.register()
        cvdgs.unregister()


def test_a_process_that_forgets_to_unregister_ends(tmp_path):
    """Blender 4.5 would hang in its own clean-up; here even with a worker that still runs."""
    program = interpreter(tmp_path, SLEEPING)
    code = (
        f"import runpy\n"
        f"runpy.run_path({bootstrap.__file__!r})['load']()\n"
        f"import bpy, cvdgs; cvdgs.register()\n"
        f"bpy.context.scene.cvdgs.capture.folder = {str(tmp_path)!r}\n"
        f"from cvdgs.cvdgs_addon.making import start_run\n"
        f"start_run(bpy.context.scene)\n"
        f"print('end', flush=True)\n"
    )
    environment = {**os.environ, "CVDGS_PYTHON": program}
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environment)
    assert result.stdout.strip().splitlines()[-1] == "end", result.stderr
    assert result.returncode == 0


def test_blenders_side_needs_numpy_only():
    """Blender's own Python has none of the worker's libraries."""
    modules = sorted(path.stem for path in Path(scene.__file__).parent.glob("*.py") if path.stem != "__init__")
    code = (
        f"import importlib, os, runpy, sys\n"
        f"runpy.run_path({bootstrap.__file__!r})['load']()\n"
        f"import cvdgs; cvdgs.register()\n"
        f"for name in {modules!r}: importlib.import_module('cvdgs.cvdgs_addon.scene.' + name)\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], flush=True)\n"
        f"os._exit(0)\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert result.stdout.strip().splitlines()[-1] == "[]", result.stderr
