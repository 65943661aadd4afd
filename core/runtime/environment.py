"""Makes the Python environment that the worker needs. Standard library only: any Python of a fitting version runs this.

The environment is a folder of its own (venv), filled by pip: with the very files of requirements.txt, checked by their
hashes, where these are for this Python, else with what pyproject.toml requires. Where the packages come from is pip's
business (its own settings and environment variables hold). The environment is marked as complete at the very end, with
what it was made for: it outlives updates of the extension, which may need other packages.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from ..bootstrap import OLDEST_PYTHON, ROOT
from ..errors import InputError
from ..files.untrusted import is_there, read_text
from ..runs.folder import is_held, lock_exclusively, open_lock
from .protocol import Reporter

STAGE = "environment"
LISTED_PYTHONS = ((3, 11), (3, 12), (3, 13))
"""What the files below are for. Blender up to 5.0 has the first, 5.1 and 5.2 the last."""

REQUIREMENTS = ROOT / "requirements.txt"
TORCH_REQUIREMENTS = ROOT / "requirements-torch.txt"
CUDA_REQUIREMENTS = ROOT / "requirements-cuda.txt"
PACKAGES = {
    "numpy": "numpy",
    "torch": "torch",
    "warp": "warp-lang",
    "pycolmap": "pycolmap",
    "OpenImageIO": "OpenImageIO",
    "kornia": "kornia",
    "colour": "colour-science",
    "safetensors": "safetensors",
    "plyfile": "plyfile",
    "scipy": "scipy",
    "zstandard": "zstandard",
    "jinja2": "Jinja2",
    "PIL": "Pillow",
}
"""Module to distribution: what the worker imports (pyproject.toml), in the order in which a user would miss it."""

WORKER_EXTRAS = ("photographs", "video")
"""Of pyproject.toml, in requirements.txt too, so that what a telephone gives is read without a further step."""

_COMPLETE = ".complete"
_MOST_MARK_BYTES = 1 << 16
_LOCK_SUFFIX = ".lock"  # of the file beside the folder; the lock on it vanishes with the process that holds it
_PROBE_SECONDS = 10.0  # for a Python to say whether it can make environments
_PACKAGES_EACH = 2.5  # that a required package brings along, itself included: the worker's 13 are 23, 42 with CUDA
_LOG_LINES = 12  # of pip's last words, kept for the message when it fails
# From pip's own words: "Collecting numpy", "Downloading numpy-2.whl (15 MB)".
_COLLECTING = re.compile(r"^Collecting (\S+)")
_DOWNLOADING = re.compile(r"^\s*(?:Downloading|Using cached) (\S+?)-\S+ \(([^)]*)\)")
# Shares of the time until collecting and downloading are done, and installing begins.
_VENV_SHARE, _INSTALLING_SHARE = 0.05, 0.8


def python_in(folder: Path) -> Path:
    """The interpreter of the environment in `folder`."""
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def is_complete(folder: Path) -> bool:
    """Whether `make_environment` has finished there, and for the packages that this version of cvdgs needs."""
    try:
        made_for = read_text(folder / _COMPLETE, most_bytes=_MOST_MARK_BYTES)
    except InputError:
        return False
    return made_for == mark() and python_in(folder).is_file()


def is_outdated(folder: Path) -> bool:
    """Whether `make_environment` has finished there, but for another version of cvdgs, or its base Python has gone."""
    return is_there(folder / _COMPLETE) and not is_complete(folder)


@cache
def mark() -> str:
    """What says in a complete environment what it was made for: the ranges of the packages, and not their versions."""
    project = _project()
    extras = [package for name in WORKER_EXTRAS for package in project["optional-dependencies"][name]]
    return "\n".join([*project["dependencies"], *extras]) + "\n"


def can_make_environments(python: str) -> bool:
    """Whether `python` can be run, is not too old, and has what `make_environment` needs."""
    probe = f"import sys, venv, ensurepip; sys.exit(sys.version_info[:2] < {OLDEST_PYTHON})"
    try:
        return subprocess.run([python, "-I", "-c", probe], capture_output=True, timeout=_PROBE_SECONDS).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False


def requirements() -> list[str]:
    """What the worker needs, as ranges."""
    return list(_project()["dependencies"])


def _project() -> dict[str, Any]:
    import tomllib  # Python 3.10, which shall be able to run the doctor, has none

    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _to_stderr(line: str) -> None:
    print(line, file=sys.stderr)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other processes from making or removing the environment in `folder`.

    Raises:
        InputError: one does.
        OSError: files cannot be locked there.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with open_lock(folder.with_name(folder.name + _LOCK_SUFFIX)) as lock:
        try:
            lock_exclusively(lock)
        except OSError as error:
            if not is_held(error):
                raise
            what = "another program, such as a second Blender, is setting up the worker"
            raise InputError(what, where=folder, remedy="wait for it") from None
        yield


def discard_environment(folder: Path) -> None:
    """Delete the environment in `folder`.

    Raises:
        InputError: another process is making it.
        OSError: the folder cannot be written.
    """
    with _alone(folder):
        _delete(folder)


def _delete(folder: Path) -> None:
    with suppress(OSError):  # first: what is left where this is cut short is not complete
        (folder / _COMPLETE).unlink()
    shutil.rmtree(folder, ignore_errors=True)


def make_environment(folder: Path, reporter: Reporter, wanted: Sequence[str] | None = None) -> Path:
    """Make the environment in `folder`; returns its interpreter. What was there is replaced.

    Args:
        reporter: told of every download.
        wanted: packages as pip takes them; None takes `REQUIREMENTS`, or `requirements` where these do not fit.

    Raises:
        InputError: this Python cannot make environments, a package cannot be had, or another process makes it.
        OSError: the folder cannot be written.
    """
    if sys.version_info[:2] < OLDEST_PYTHON:
        version = f"Python {sys.version_info[0]}.{sys.version_info[1]}"
        remedy = f"use Python {'.'.join(map(str, OLDEST_PYTHON))} or later"
        raise InputError(f"{version} is too old", where=sys.executable, remedy=remedy)
    with _alone(folder):
        reporter.status(STAGE, f"making an environment for Python {sys.version_info[0]}.{sys.version_info[1]}")
        _make(folder, reporter, wanted)
    reporter.progress(STAGE, 1.0, "done")
    return python_in(folder)


def _make(folder: Path, reporter: Reporter, wanted: Sequence[str] | None) -> None:
    _delete(folder)
    folder.mkdir()
    try:
        venv.create(folder, with_pip=True, symlinks=os.name != "nt")
    except (subprocess.CalledProcessError, ImportError):
        remedy = "choose another Python, or install this one's venv and ensurepip (Debian: python3-venv)"
        raise InputError("cannot make environments", where=sys.executable, remedy=remedy) from None
    reporter.progress(STAGE, _VENV_SHARE, "downloading")
    if wanted is None and sys.version_info[:2] in LISTED_PYTHONS:
        install_locked(python_in(folder), reporter)
    else:
        packages = list(requirements() if wanted is None else wanted)
        progress = _PipProgress(round(len(packages) * _PACKAGES_EACH), reporter)
        _run_pip(python_in(folder), ["install", *packages], progress, _to_stderr)
    (folder / _COMPLETE).write_text(mark(), encoding="utf-8", newline="\n")


def install_locked(
    python: Path, reporter: Reporter, requirements: Path = REQUIREMENTS, log: Callable[[str], None] = _to_stderr
) -> None:
    """Install exactly the files of a list into an environment, and torch in whichever build pip is configured to take.

    Nothing else is installed: what the packages need in turn is not looked up but listed. pip would rather take a build
    that its index announces with a listed hash than any other, so torch's build is chosen without looking at hashes
    first, and checked then.

    Args:
        python: the environment's.
        requirements: the list; those that it includes count as well.
        log: receives what pip says.

    Raises:
        InputError: a file cannot be had, or is not the listed one.
    """
    (torch,) = re.findall(r"^torch==\S+", TORCH_REQUIREMENTS.read_text(encoding="utf-8"), re.MULTILINE)
    progress = _PipProgress(_count_entries(requirements) + 1, reporter)
    locked = ["install", "--require-hashes", "--no-deps"]
    with tempfile.TemporaryDirectory(dir=python.parent) as folder:
        _run_pip(python, ["download", "--no-deps", "--dest", folder, torch], progress, log)
        from_folder = ["--no-index", "--find-links", folder, "--requirement", str(TORCH_REQUIREMENTS)]
        _run_pip(python, [*locked, *from_folder], progress, log)
    _run_pip(python, [*locked, "--requirement", str(requirements)], progress, log)
    if subprocess.run([str(python), "-m", "pip", "check"], capture_output=True).returncode != 0:
        # torch came as a build with CUDA, whose libraries are packages too.
        _run_pip(python, [*locked, "--requirement", str(CUDA_REQUIREMENTS)], progress, log)


def _count_entries(requirements: Path) -> int:
    text = requirements.read_text(encoding="utf-8")
    included = re.findall(r"^-r (\S+)", text, re.MULTILINE)
    own = len(re.findall(r"^[\w.-]+==", text, re.MULTILINE))
    return own + sum(_count_entries(requirements.with_name(name)) for name in included)


def _run_pip(python: Path, arguments: Sequence[str], progress: _PipProgress, log: Callable[[str], None]) -> None:
    action, *rest = arguments
    options = ["--no-input", "--disable-pip-version-check", "--only-binary", ":all:"]
    command = [str(python), "-m", "pip", action, *options, *rest]
    last: list[str] = []
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        env={**os.environ, "PYTHONUNBUFFERED": "1"},  # else what pip says arrives when it has ended
    ) as pip:
        assert pip.stdout is not None
        for line in pip.stdout:
            log(line.rstrip())
            last = [*last, line.strip()][-_LOG_LINES:]
            progress.read(line)
    if pip.returncode != 0:
        complaints = [line for line in last if line.startswith("ERROR")] or last[-1:]
        remedy = "check the internet connection and the free disk space, then try again"
        raise InputError(f"the packages cannot be installed: {' '.join(complaints)}", where=python, remedy=remedy)


class _PipProgress:
    """From what pip prints to how far it is.

    Args:
        expected: number of packages that will be installed.
    """

    def __init__(self, expected: int, reporter: Reporter) -> None:
        self._expected = max(expected, 1)
        self._reporter = reporter
        self._collected = 0

    def read(self, line: str) -> None:
        """Take in a line."""
        if found := _COLLECTING.match(line):
            self._collected += 1
            self._tell(f"looking for {found[1]}")
        elif found := _DOWNLOADING.match(line):
            self._tell(f"downloading {found[1]} ({found[2]})")
        elif line.startswith("Installing collected packages"):
            self._reporter.progress(STAGE, self._share, "installing; this takes a minute or two")

    @property
    def _share(self) -> float:
        share = min(self._collected / self._expected, 1.0)
        return _VENV_SHARE + (_INSTALLING_SHARE - _VENV_SHARE) * share

    def _tell(self, message: str) -> None:
        self._reporter.progress(STAGE, self._share, message)
