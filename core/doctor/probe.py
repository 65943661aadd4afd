"""Reports what an interpreter has, in its last line of output. Run as a file by that interpreter, whatever it has.

    PYTHON core/doctor/probe.py MODULE=DISTRIBUTION ...

    {"python": "3.11.7", "packages": {"torch": {"version": "2.13.0", "problem": null}, ...}, "cache": ..., "cuda": ...}

Importing shows what a list of installed packages does not: a library of the system that is missing.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import platform
import sys
import tempfile
from importlib import metadata
from typing import Any


def main(arguments: list[str]) -> dict[str, Any]:
    """What is asked for, each package tried on its own."""
    packages = {}
    for argument in arguments:
        module, _, distribution = argument.partition("=")
        packages[distribution] = try_package(module, distribution)
    answer: dict[str, Any] = {"python": platform.python_version(), "packages": packages, "cache": None, "cuda": None}
    if "warp" in sys.modules:
        answer.update(ask_warp())
    return answer


def try_package(module: str, distribution: str) -> dict[str, Any]:
    """Its version, None when it is not installed, and why it cannot be imported, None when it can."""
    try:
        version = metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return {"version": None, "problem": "is not installed"}
    try:
        importlib.import_module(module)
    except BaseException as error:  # a broken library may raise anything, SystemExit included
        lines = str(error).strip().splitlines() or [""]
        return {"version": version, "problem": f"{type(error).__name__}: {lines[-1]}"}
    return {"version": version, "problem": None}


def ask_warp() -> dict[str, Any]:
    """Whether kernels can be kept, and which CUDA devices Warp can use."""
    import warp

    warp.config.quiet = True
    try:
        warp.init()
        folder = warp.config.kernel_cache_dir
        with tempfile.TemporaryFile(dir=folder):
            pass
        problem = None
    except (OSError, RuntimeError) as error:
        folder = warp.config.kernel_cache_dir or os.environ.get("WARP_CACHE_PATH")
        return {"cache": {"folder": folder, "problem": str(error).splitlines()[0]}, "cuda": None}
    return {
        "cache": {"folder": folder, "problem": problem},
        "cuda": [device.name for device in warp.get_cuda_devices()],
        "cuda_in_torch": "torch" in sys.modules and sys.modules["torch"].cuda.is_available(),
        "cuda_versions": [warp.get_cuda_driver_version(), warp.get_cuda_toolkit_version()],
    }


if __name__ == "__main__":
    sys.path.pop(0)  # this folder, where our modules would hide others of the same names
    print("\n" + json.dumps(main(sys.argv[1:])), flush=True)
    if "bpy" in sys.modules:  # which would remove it at the end that it does not come to
        with contextlib.suppress(OSError):  # only while empty: without a folder of its own, Blender names everybody's
            os.rmdir(sys.modules["bpy"].app.tempdir)
    os._exit(0)  # some libraries do not end well in a process that has barely used them
