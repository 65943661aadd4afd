"""Asks interpreters and Blender which packages and versions they have. Standard library only."""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..runtime.process import variables_of_interpreters

PROBE = Path(__file__).with_name("probe.py")
# A cold disk takes a minute to import torch; a program that never answers is not waited for.
_PATIENCE_SECONDS = 180.0

Answer = dict[str, Any]


def ask(python: str, modules: dict[str, str]) -> Answer:
    """Which of `modules` (module to distribution) `python` has, as reported by `probe.main`.

    Raises:
        InputError: it cannot be run, or does not answer.
    """
    arguments = [f"{module}={distribution}" for module, distribution in modules.items()]
    lines = _run([python, str(PROBE), *arguments]).splitlines()
    try:
        answer = json.loads(lines[-1])
    except (IndexError, ValueError):
        raise InputError(
            "does not behave like a Python interpreter", where=python, remedy="name a Python 3 interpreter"
        ) from None
    if not isinstance(answer, dict) or "packages" not in answer:
        raise InputError(
            "does not behave like a Python interpreter", where=python, remedy="name a Python 3 interpreter"
        )
    return answer


def blender_version(program: str) -> str:
    """The first line of what `program` says of its version.

    Raises:
        InputError: it cannot be run.
    """
    first, *_ = _run([program, "--version"]).strip().splitlines() or [""]
    return first


def _run(command: list[str]) -> str:
    try:
        result = subprocess.run(
            command,
            capture_output=True,
            text=True,
            encoding="utf-8",
            errors="replace",
            env=variables_of_interpreters(),
            timeout=_PATIENCE_SECONDS,
        )
    except (OSError, subprocess.SubprocessError) as error:
        reason = getattr(error, "strerror", None) or f"no answer in {_PATIENCE_SECONDS:.0f} s"
        raise InputError(f"cannot be run ({reason})", where=command[0], remedy="check the installation") from None
    if result.returncode != 0:
        last = result.stderr.strip().splitlines()[-1:] or [f"exit code {result.returncode}"]
        raise InputError(f"fails ({last[0]})", where=command[0], remedy="check the installation")
    return result.stdout


class State(Enum):
    """The state of a thing; the values are printed before each line and read by programs."""

    OK = "ok"
    NOTE = "note"
    """It is missing or scarce, and the main job runs all the same."""
    MISSING = "missing"


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report.

    Attributes:
        name: of the thing.
        state: whether it is here.
        found: what was found, or what is wrong.
        remedy: how to get it, as an imperative sentence without a full stop; empty where nothing has to be done.
    """

    name: str
    state: State
    found: str
    remedy: str = ""

    @classmethod
    def of_error(cls, name: str, error: InputError) -> Finding:
        """The thing is missing, for the reason in `error`."""
        found = f"{error.where}: {error.what}" if error.where else error.what
        return cls(name, State.MISSING, found, error.remedy)

    def to_dict(self) -> dict[str, str]:
        """A JSON-ready dictionary."""
        return {"name": self.name, "state": self.state.value, "found": self.found, "remedy": self.remedy}
