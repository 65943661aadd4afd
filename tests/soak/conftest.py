"""Long repetitions; Blender's need a bpy wheel."""

from __future__ import annotations

import importlib.util

if importlib.util.find_spec("bpy") is None:
    collect_ignore_glob = ["test_blender.py"]
else:
    from ..addon.conftest import addon, capture, run_folder, worker

    __all__ = ["addon", "capture", "run_folder", "worker"]
