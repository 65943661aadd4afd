"""All checks of the doctor. Standard library only."""

from __future__ import annotations

import ctypes.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..bootstrap import ROOT
from ..errors import InputError
from ..runtime.devices import TORCH_WITHOUT_CUDA, missing_for_cuda
from ..runtime.environment import LISTED_PYTHONS, PACKAGES, can_make_environments
from ..runtime.process import blender_command, find_python
from ..runtime.protocol import Reporter
from ..runtime.resources import this_machine
from .interpreters import Answer, Finding, State, ask, blender_version

STAGE = "doctor"


def examine(reporter: Reporter | None = None) -> Iterator[Finding]:
    """Every finding as it is made; some seconds, because packages are imported to see whether they work."""
    tell = (reporter or Reporter()).status
    tell(STAGE, "checking the worker's Python")
    worker = list(examine_worker())
    yield Finding("this Python", State.OK, f"{platform.python_version()} ({sys.executable})")
    yield from worker
    tell(STAGE, "checking Blender")
    worker_is_here = worker[0].state is State.OK
    yield from examine_blender(worker_is_here=worker_is_here)
    yield from examine_computer(environment_is_here=worker_is_here)


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
        remedy = "set up the worker first, which includes it, or set CVDGS_BLENDER to a Blender program"
        blender = Finding("Blender", State.MISSING, "cannot be looked for before there is a worker", remedy)
    yield blender
    if is_module:  # a Blender program brings its libraries, or its package asks for them
        yield from _system_libraries()
    if sys.platform.startswith("linux") and ctypes.util.find_library("EGL") is None:
        remedy = "install it (Debian: libegl1 and libgl1-mesa-dri)"
        yield Finding("EGL", State.NOTE, "is not found; EEVEE needs it, and the compositor from Blender 5.2 on", remedy)


def _blender() -> tuple[Finding, bool]:
    """The finding, and whether Blender is, or would be, the bpy module."""
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
    """Packages that the bpy wheel needs according to `SYSTEM_LIBRARIES`; nothing where that cannot be run."""
    if not SYSTEM_LIBRARIES.is_file() or os.name != "posix":
        return
    try:
        command = ["sh", str(SYSTEM_LIBRARIES), "--check"]
        missing = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20.0).stdout.split()
    except (OSError, subprocess.SubprocessError):
        return
    if missing:
        found = f"{len(missing)} that Blender's module needs are missing"
        yield Finding("libraries", State.MISSING, found, _how_to_install(missing))
    else:
        yield Finding("libraries", State.OK, "everything that Blender's module needs")


def _how_to_install(packages: Sequence[str]) -> str:
    names = " ".join(packages)
    if shutil.which("apt-get") is None:
        return f"install the packages that Debian calls {names}"
    if os.geteuid() == 0:  # a root without packages has neither sudo nor apt's lists
        return f"run 'sh {SYSTEM_LIBRARIES}', which installs {names}"
    return f"sudo apt-get install {names}"


# The demo's worker peaks at 1.1 GB (README); Blender and the system want as much again.
LEAST_MEMORY_MB = 2500
# An environment takes 3.6 GB, some 4 GB more where torch brings CUDA (docs/faq.md); pip needs room for its downloads.
LEAST_DISK_MB = 10_000
# A run of the demo leaves 36 MB; captures of larger photographs take ten times that.
LEAST_TEMPORARY_MB = 500
_MB = 1_000_000


def examine_computer(*, environment_is_here: bool) -> Iterator[Finding]:
    """What this machine has; `environment_is_here`: nothing has to be installed any more."""
    machine = this_machine()
    yield Finding("cores", State.OK, str(machine.cores))
    found = f"{machine.memory_mb / 1000:.1f} GB"
    if machine.memory_mb < LEAST_MEMORY_MB:
        yield Finding("memory", State.NOTE, found, "close other programs, and use --max-size 320 and --gaussians 20000")
    else:
        yield Finding("memory", State.OK, found)
    yield _disk("disk", ROOT, LEAST_TEMPORARY_MB if environment_is_here else LEAST_DISK_MB)
    yield _temporary_files()
    yield _graphics_card()


def _temporary_files() -> Finding:
    name = "temporary files"
    try:
        return _disk(name, Path(tempfile.gettempdir()), LEAST_TEMPORARY_MB)
    except OSError:  # none of the usual folders can be written to
        remedy = f"free {LEAST_TEMPORARY_MB / 1000:g} GB, or set TMPDIR to a folder on another disk"
        return Finding(name, State.MISSING, "no folder for them can be written to", remedy)


def _disk(name: str, folder: Path, least_mb: int) -> Finding:
    free = shutil.disk_usage(folder).free // _MB
    found = f"{free / 1000:.1f} GB free at {folder}"
    if free < least_mb:
        return Finding(name, State.NOTE, found, f"free {least_mb / 1000:g} GB, or use another disk")
    return Finding(name, State.OK, found)


def _graphics_card() -> Finding:
    program = shutil.which("nvidia-smi")
    if program is None:
        return Finding("graphics card", State.NOTE, "no NVIDIA driver; the CPU is used")
    query = [program, "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    try:
        answer = subprocess.run(query, capture_output=True, text=True, timeout=20.0, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return Finding("graphics card", State.NOTE, "the NVIDIA driver does not respond; the CPU is used", "reboot")
    return Finding("graphics card", State.OK, "; ".join(answer.splitlines()))


OPTIONAL = {
    "av": ("av", "videos"),
    "pillow_heif": ("pillow-heif", "HEIC photographs"),
    "rawpy": ("rawpy", "raw photographs"),
    "distributed": ("distributed", "batches with --cluster"),
    "openjd.cli": ("openjd-cli", "running what --export openjd writes"),
    "pxr": ("usd-core", "convert.py to .usd"),
}


def examine_worker() -> Iterator[Finding]:
    """The interpreter that workers are started with, its packages, and its kernels' cache."""
    try:
        python = find_python()
        answer = ask(python, {**PACKAGES, **{module: name for module, (name, _) in OPTIONAL.items()}})
    except InputError as error:
        yield Finding.of_error("worker", error)
        yield from _what_makes_one()
        return
    yield Finding("worker", State.OK, f"Python {answer['python']} ({python})")
    packages = answer["packages"]
    for name in PACKAGES.values():
        version, problem = packages[name]["version"], packages[name]["problem"]
        if problem is None:
            yield Finding(name, State.OK, version)
        else:
            found = problem if version is None else f"{version} cannot be imported ({problem})"
            yield Finding(name, State.MISSING, found, _package_remedy(name, python))
    for name, purpose in OPTIONAL.values():
        if packages[name]["problem"] is None:
            yield Finding(name, State.OK, packages[name]["version"])
        else:
            yield Finding(
                name, State.NOTE, f"is not installed; needed only for {purpose}", f"{python} -m pip install {name}"
            )
    yield from _kernels(answer)


def _package_remedy(name: str, python: str) -> str:
    environment = ROOT / ".venv"
    if Path(python).is_relative_to(environment):
        return f"delete {environment} and run 'make venv' in {ROOT}"
    return f"{python} -m pip install {name}"


def _kernels(answer: Answer) -> Iterator[Finding]:
    cache = answer["cache"]
    if cache is None:
        return  # Warp is missing, which has been said
    if cache["problem"]:
        remedy = "set WARP_CACHE_PATH to a folder that you can write to"
        yield Finding("kernels", State.MISSING, f"{cache['folder']} cannot be written to ({cache['problem']})", remedy)
    else:
        yield Finding("kernels", State.OK, f"cached in {cache['folder']}")
    yield cuda_finding(answer)


def cuda_finding(answer: Answer) -> Finding:
    """Whether there is a graphics card that training can use; `answer` is the probe's."""
    devices = answer["cuda"]
    if devices and answer["cuda_in_torch"]:
        return Finding("CUDA", State.OK, ", ".join(devices))
    missing = TORCH_WITHOUT_CUDA if devices else missing_for_cuda(*answer.get("cuda_versions", (None, None)))
    return Finding("CUDA", State.NOTE, f"{missing}; the CPU is used")


def _what_makes_one() -> Iterator[Finding]:
    """What `make venv` needs."""
    names = [f"python{major}.{minor}" for major, minor in LISTED_PYTHONS]
    candidates = [python for python in map(shutil.which, names) if python is not None]
    if sys.version_info[:2] in LISTED_PYTHONS:
        candidates.append(sys.executable)
    python = next(filter(can_make_environments, candidates), None)
    if python is not None:
        yield Finding("Python", State.OK, f"{python} can make the worker's environment")
    elif candidates:
        remedy = "install its venv and ensurepip (Debian: python3-venv)"
        yield Finding("Python", State.MISSING, f"{candidates[0]} cannot make environments", remedy)
    else:
        remedy = "install Python 3.11 or 3.13 (Debian: python3 and python3-venv; elsewhere from python.org or pyenv)"
        remedy += ", or let the add-on make an environment (Preferences > Add-ons > cvdgs) and set CVDGS_PYTHON to it"
        yield Finding("Python", State.MISSING, f"none of {', '.join(names)} is found; 'make venv' needs one", remedy)
    if shutil.which("make") is None:
        remedy = f"install make, or run the commands of the Makefile's venv target in {ROOT}"
        yield Finding("make", State.MISSING, "is not found", remedy)
