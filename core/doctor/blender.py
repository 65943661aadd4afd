"""A look at Blender, for the doctor and before a run: as a program, as this process, or as the bpy wheel.

Standard library only.
"""

from __future__ import annotations

import ctypes.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence

from ..bootstrap import ROOT
from ..errors import InputError
from ..job import blender_command
from .finding import Finding, State
from .interpreters import ask, blender_version

SYSTEM_LIBRARIES = ROOT / "scripts" / "system_libraries.sh"


def require_blender() -> None:
    """Make sure, before anything long, that Blender's part of a run can start.

    A Blender program is looked for, and the bpy module imported by its interpreter, which takes some seconds: that it
    is installed says nothing of the system's libraries.

    Raises:
        InputError: there is none, or it cannot be used.
    """
    if "bpy" in sys.modules and not os.environ.get("CVDGS_BLENDER"):
        return
    program, *arguments = blender_command([])
    if "-b" not in arguments:
        _module_version(program)
    elif shutil.which(program) is None:
        what = "is not a program that can be run"
        raise InputError(what, where=f"CVDGS_BLENDER={program}", remedy="name a Blender, or do without: --no-blend")


def examine_blender(*, worker_is_here: bool) -> Iterator[Finding]:
    """The Blender that makes scene.blend, and what it needs of the system."""
    blender, is_module = _blender()
    if blender.state is State.MISSING and not worker_is_here:
        # Without a worker nothing is known of its bpy module, and whoever makes the worker gets both.
        remedy = "make the worker first, which has it; or set CVDGS_BLENDER to a Blender program"
        blender = Finding("Blender", State.MISSING, "is looked for beside the worker, which is missing", remedy)
    yield blender
    if is_module:  # a Blender program brings its libraries, or its package asks for them
        yield from _system_libraries()
    if sys.platform.startswith("linux") and ctypes.util.find_library("EGL") is None:
        remedy = "install it (Debian: libegl1 and libgl1-mesa-dri)"
        yield Finding("EGL", State.NOTE, "is not found; EEVEE needs it, and the compositor from Blender 5.2 on", remedy)


def _blender() -> tuple[Finding, bool]:
    """What is found of it, and whether it is, or would be, the bpy module."""
    this = sys.modules.get("bpy")
    if this is not None and this.app.binary_path and not os.environ.get("CVDGS_BLENDER"):
        return Finding("Blender", State.OK, f"{this.app.version_string} ({this.app.binary_path})"), False
    is_module = True
    try:
        program, *arguments = blender_command([])
        is_module = "-b" not in arguments
        if not is_module:
            return Finding("Blender", State.OK, f"{blender_version(program)} ({program})"), is_module
        return Finding("Blender", State.OK, f"bpy module {_module_version(program)} ({program})"), is_module
    except InputError as error:
        return Finding.of_error("Blender", error), is_module


def _module_version(python: str) -> str:
    """The version of the bpy module of `python`.

    Raises:
        InputError: it cannot be imported.
    """
    module = ask(python, {"bpy": "bpy"})["packages"]["bpy"]
    if module["problem"]:
        remedy = f"run 'sh {SYSTEM_LIBRARIES}', or do without Blender: --no-blend"
        raise InputError(f"Blender's module cannot be used ({module['problem']})", where=python, remedy=remedy)
    return module["version"]


def _system_libraries() -> Iterator[Finding]:
    """Packages that the bpy wheel needs, as `SYSTEM_LIBRARIES` knows them; nothing where there is no such knowledge."""
    if not SYSTEM_LIBRARIES.is_file() or os.name != "posix":
        return
    try:
        command = ["sh", str(SYSTEM_LIBRARIES), "--check"]
        missing = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20.0).stdout.split()
    except (OSError, subprocess.SubprocessError):
        return
    if missing:
        found = f"{len(missing)} that Blender's module loads are missing"
        yield Finding("libraries", State.MISSING, found, _how_to_install(missing))
    else:
        yield Finding("libraries", State.OK, "all that Blender's module loads")


def _how_to_install(packages: Sequence[str]) -> str:
    names = " ".join(packages)
    if shutil.which("apt-get") is None:
        return f"install what Debian calls {names}"
    if os.geteuid() == 0:  # a root without packages has neither sudo nor apt's lists
        return f"run 'sh {SYSTEM_LIBRARIES}', which installs {names}"
    return f"sudo apt-get install {names}"
