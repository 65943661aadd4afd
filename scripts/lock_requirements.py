"""Write requirements*.txt: what `make venv` and the worker's environment install, by exact version and hash.

    python -m pip install uv
    python scripts/lock_requirements.py              # after a change of pyproject.toml; keeps the versions there are
    python scripts/lock_requirements.py --upgrade    # the newest versions that pyproject.toml allows

uv resolves for all platforms at once, so the files hold the hashes of Linux's, macOS' and Windows' builds. Which index
it asks is uv's business (UV_DEFAULT_INDEX). Exit codes: 0 done, 2 uv is missing or refuses.
"""

from __future__ import annotations

import argparse
import importlib.util
import re
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load()
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import exit_code
from cvdgs.core.runtime.environment import (
    CUDA_REQUIREMENTS,
    LISTED_PYTHONS,
    REQUIREMENTS,
    TORCH_REQUIREMENTS,
    WORKER_EXTRAS,
)

DEVELOPMENT_REQUIREMENTS = bootstrap.ROOT / "requirements-dev.txt"
BPY45_REQUIREMENTS = bootstrap.ROOT / "requirements-bpy45.txt"
BPY52_REQUIREMENTS = bootstrap.ROOT / "requirements-bpy52.txt"
FUZZ_REQUIREMENTS = bootstrap.ROOT / "requirements-fuzz.txt"
DEVELOPMENT_EXTRAS = ("blender", "test", "lint")
FUZZ_EXTRA = "fuzz"
LISTS = (REQUIREMENTS, TORCH_REQUIREMENTS, CUDA_REQUIREMENTS, DEVELOPMENT_REQUIREMENTS, FUZZ_REQUIREMENTS)
BUILD = ["setuptools>=77"]  # pyproject.toml's build-system, which is not fetched when the package itself is installed
# What the add-on's tests need; their worker is another environment's.
ADDON_TESTS = ["hypothesis", "pytest", "pytest-timeout", "pytest-xdist", "zstandard"]
BPY45, BPY52 = "bpy>=4.5,<4.6", "bpy>=5.2,<5.3"

# torch's build for Linux loads these; a build without CUDA does without gigabytes of them.
_CUDA = re.compile(r"^(nvidia|cuda|triton)\b")
# Builds of torch that an index of packages does not have beside the others: the one for Linux without CUDA.
_OTHER_BUILDS = {"torch==2.13.0": ["6746dbcbeb526eb61330b76b41ff1b4eb848951103a892eeb080dfa2b264667b"]}

Lock = dict[str, str]
"""Requirement with its marker to its whole entry, hashes included, sorted by name."""


def resolve(
    source: Path,
    extras: tuple[str, ...] = (),
    keep: tuple[Path, ...] = (),
    python: tuple[int, int] = LISTED_PYTHONS[0],
) -> Lock:
    """What `source` (a pyproject.toml or a list of requirements) needs, with all that it needs in turn.

    Args:
        extras: of a pyproject.toml.
        keep: files whose versions are taken where they fit.
        python: the oldest that it is for.

    Raises:
        InputError: uv is missing or cannot resolve it.
    """
    if importlib.util.find_spec("uv") is None:
        raise InputError("uv is missing", where=sys.executable, remedy=f"{sys.executable} -m pip install uv")
    command = [sys.executable, "-m", "uv", "pip", "compile", str(source), "--universal", "--generate-hashes"]
    command += ["--python-version", ".".join(map(str, python)), "--no-header", "--no-annotate", "--quiet"]
    command += [option for extra in extras for option in ("--extra", extra)]
    command += [option for path in keep if path.is_file() for option in ("--constraint", str(path))]
    result = subprocess.run(command, capture_output=True, text=True)
    if result.returncode != 0:
        complaint = " ".join(result.stderr.split())
        raise InputError(f"uv refuses ({complaint})", where=source, remedy="change the versions that it asks for")
    entries = re.split(r"\n(?=\S)", result.stdout.strip())
    return {entry.partition(" \\\n")[0]: entry for entry in map(with_other_builds, entries)}


def with_other_builds(entry: str) -> str:
    """The entry, allowing the builds that uv's index does not know."""
    hashes = _OTHER_BUILDS.get(entry.partition(" ")[0], [])
    return " \\\n".join([entry, *(f"    --hash=sha256:{value}" for value in hashes)])


def require_other_builds(torch: Lock) -> None:
    """Refuse a version of torch whose build for CPUs nobody has looked up: without its hash it would be refused later.

    Raises:
        InputError: `_OTHER_BUILDS` does not know it.
    """
    for requirement in torch:
        version = requirement.partition(" ")[0]
        if version not in _OTHER_BUILDS:
            remedy = "add the hash of its build for CPUs to _OTHER_BUILDS (torch's own index shows it)"
            raise InputError(f"{version} is new here", where=Path(__file__).name, remedy=remedy)


def without(lock: Lock, other: Lock) -> Lock:
    """The entries whose packages `other` does not have."""
    names = {requirement.partition("==")[0] for requirement in other}
    return {requirement: entry for requirement, entry in lock.items() if requirement.partition("==")[0] not in names}


def resolve_addon_tests(bpy: str, python: tuple[int, int], keep: tuple[Path, ...]) -> Lock:
    """What the add-on's tests need on one of Blender's modules.

    Args:
        bpy: the module, as pip takes it.
        python: the one that it is built for.
        keep: as for `resolve`.
    """
    with tempfile.TemporaryDirectory() as folder:
        wanted = Path(folder) / "requirements.in"
        wanted.write_text("\n".join([bpy, *ADDON_TESTS]) + "\n", encoding="utf-8")
        return resolve(wanted, keep=keep, python=python)


def write(path: Path, about: str, lock: Lock, *, includes: Path | None = None) -> None:
    """Write one file."""
    lines = [f"# {about}. Written by scripts/lock_requirements.py."]
    lines += [f"-r {includes.name}"] if includes else []
    path.write_text("\n".join([*lines, *lock.values()]) + "\n", encoding="utf-8")


def lock_all(*, upgrade: bool) -> None:
    """Resolve everything, then write all files."""
    project = bootstrap.ROOT / "pyproject.toml"
    keep = () if upgrade else LISTS
    with tempfile.TemporaryDirectory() as folder:
        wanted = Path(folder) / "requirements.in"
        wanted.write_text("\n".join(BUILD) + "\n", encoding="utf-8")
        build = resolve(wanted, keep=keep)
    bpy45 = resolve_addon_tests(BPY45, (3, 11), () if upgrade else (BPY45_REQUIREMENTS,))
    bpy52 = resolve_addon_tests(BPY52, (3, 13), () if upgrade else (BPY52_REQUIREMENTS,))
    everything = resolve(project, DEVELOPMENT_EXTRAS, keep)
    fuzz = without(resolve(project, (*DEVELOPMENT_EXTRAS, FUZZ_EXTRA), keep), everything)
    worker = without(everything, without(everything, resolve(project, WORKER_EXTRAS, keep)))
    cuda = {requirement: entry for requirement, entry in worker.items() if _CUDA.match(requirement)}
    torch = {requirement: entry for requirement, entry in worker.items() if requirement.startswith("torch==")}
    require_other_builds(torch)
    development = without(everything, worker) | without(build, worker)
    worker = without(worker, cuda | torch)
    write(REQUIREMENTS, "The worker's packages besides torch", worker)
    write(TORCH_REQUIREMENTS, "torch, which core/runtime/environment.py installs first", torch)
    write(CUDA_REQUIREMENTS, "What torch's builds with CUDA load besides, on Linux", cuda)
    write(DEVELOPMENT_REQUIREMENTS, "What make venv installs", development, includes=REQUIREMENTS)
    write(FUZZ_REQUIREMENTS, "What tests/fuzz/campaign.py needs besides what make venv installs", fuzz)
    write(BPY45_REQUIREMENTS, "Tests on Blender 4.5, the older generation of its API (Python 3.11)", bpy45)
    write(BPY52_REQUIREMENTS, "Tests on Blender 5.2 (Python 3.13)", bpy52)


def main() -> int:
    """Parse the command line and lock; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--upgrade", action="store_true", help="take the newest versions that pyproject.toml allows")
    upgrade = parser.parse_args().upgrade
    return exit_code("lock_requirements.py", lambda: lock_all(upgrade=upgrade))


if __name__ == "__main__":
    sys.exit(main())
