"""The doctor's look at the worker's interpreter and its packages. Standard library only."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from ..bootstrap import ROOT
from ..devices import missing_for_cuda
from ..environment import LISTED_PYTHONS, PACKAGES, can_make_environments
from ..errors import InputError
from ..job import find_python
from .finding import Finding, State
from .interpreters import Answer, ask

OPTIONAL = {
    "distributed": ("distributed", "batches with --cluster"),
    "openjd.cli": ("openjd-cli", "running what --export openjd writes"),
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
            yield Finding(name, State.NOTE, f"is not installed; only for {purpose}", f"{python} -m pip install {name}")
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
        yield Finding("kernels", State.OK, f"kept in {cache['folder']}")
    devices = answer["cuda"]
    if devices:
        yield Finding("CUDA", State.OK, ", ".join(devices))
    else:
        missing = missing_for_cuda(*answer.get("cuda_versions", (None, None)))
        yield Finding("CUDA", State.NOTE, f"{missing}; the CPU is used")


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
        remedy = f"install make, or type what the Makefile's venv does, in {ROOT}"
        yield Finding("make", State.MISSING, "is not found", remedy)
