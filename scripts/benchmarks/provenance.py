"""Where a page's figures come from: its line with command, commit and recipe, and whether the recipe is still that one.

A recipe is the command and the constants that shape what it measures: the product's own and the study's. Its
fingerprint changes with each of them, so a page tells which code it is about, and a test finds pages older than that.
Code that is not a constant counts by two revisions, which are raised by hand; a test finds when small runs of the demo
show that one has to be.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...core.bootstrap import ROOT

Facts = Callable[[], tuple[Any, ...]]
"""Makes the constants that shape a study, when they are needed: some take seconds to import."""

ENHANCEMENT = 1
"""Revision of what enhancement makes of the same photographs and settings, raised when code, no constant, changes it.

Pages and stored trials of another revision are stale."""
RECONSTRUCTION = 2
"""The same of what the trainer makes of the same views."""
UNRECORDED = "unrecorded"
STALE = "the recipe has changed since: not comparable with what the code makes now"
BY_HAND = ("README.md", "observers.md", "results.md", "timings.md", "training.md", "tried.md")
"""Pages that no single command makes: entries, a protocol, logs of trainings, and a table with a command a row."""
SECONDS_PER_MINUTE = 60.0
_DIGITS = 12
_LINE = re.compile(
    r"^> Made by `(?P<command>[^`]+)` at commit `(?P<commit>[^`]+)`(?: in (?P<minutes>\d+) minutes)?, "
    r"recipe `(?P<recipe>\w+)`(?P<stale>; .+)?\.$",
    re.M,
)
_COMMAND = re.compile(r"(?:By )?`(python scripts/benchmark\.py [^`]+)`[.:]?\s?")
_WEIGHTS = ROOT / "core" / "enhance" / "gan" / "weights" / "enhancer.safetensors.sha256"


@dataclass(frozen=True)
class Provenance:
    """The line of a page.

    Attributes:
        command: as texts show it, or `UNRECORDED`.
        commit: of the code, with a plus where it had changes that were not committed.
        recipe: fingerprint, or `UNRECORDED`.
        stale: whether the line says that the recipe has changed since.
        minutes: that the command took, rounded; None where nobody wrote that down. Less than its trials took, if an
            earlier call had made some of these.
    """

    command: str
    commit: str
    recipe: str
    stale: bool = False
    minutes: int | None = None

    def __str__(self) -> str:
        ending = f"; {STALE}" if self.stale else ""
        took = "" if self.minutes is None else f" in {self.minutes} minutes"
        return f"> Made by `{self.command}` at commit `{self.commit}`{took}, recipe `{self.recipe}`{ending}."

    @property
    def part(self) -> str:
        """The subcommand of benchmark.py; "" where it is not known."""
        _, _, arguments = self.command.partition("benchmark.py ")
        return arguments.partition(" ")[0]


def enhanced_product() -> tuple[Any, ...]:
    """The revision and the constants of enhancement, and the digest of the weights."""
    from ...core.enhance.gan.trial import CORRECTION_WEIGHTS
    from ...core.enhance.scene.fit import START_WEIGHTS

    return *_fitted_product(), START_WEIGHTS, CORRECTION_WEIGHTS, weights_of_product()


def weights_of_product() -> str:
    """The digest of the weights that predict scene networks."""
    return _WEIGHTS.read_text(encoding="utf-8").split()[0]


def predicting_weights() -> str:
    """The digest of the weights that a fit begins with: all but the sizes of corrections, which stand in for one."""
    from ...core.enhance.gan.weights import load_shipped
    from ...core.files.tensors import checksum

    return checksum({name: value for name, value in load_shipped().state_dict().items() if name != "rates"})


def trained_product() -> tuple[Any, ...]:
    """The revisions and constants of enhancement and reconstruction, and what a run does by default.

    Without the weights, which only the predicted network needs.
    """
    from ...core.pipeline.stages import Plans
    from ...core.settings import Settings

    return *_fitted_product(), RECONSTRUCTION, Plans(), {field.name: field.default for field in fields(Settings)}


def _fitted_product() -> tuple[Any, ...]:
    from ...core.enhance.lut_fit import LutSettings
    from ...core.enhance.scene.fit import FitSettings

    return ENHANCEMENT, FitSettings(), LutSettings()


def fingerprint(command: str, facts: Facts) -> str:
    """Twelve hexadecimal digits that change with the command and with any of the facts."""
    text = json.dumps([command, _canonical(facts())], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def digest_of(file: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def provenance_of(text: str) -> Provenance | None:
    """What a page's line says; None without one."""
    found = _LINE.search(text)
    if found is None:
        return None
    minutes = None if found["minutes"] is None else int(found["minutes"])
    return Provenance(found["command"], found["commit"], found["recipe"], bool(found["stale"]), minutes)


def stamp(page: Path, command: str, facts: Facts, seconds: float | None = None) -> None:
    """Give a page that was made just now its line, behind its title; `seconds` is what the command took."""
    minutes = None if seconds is None else round(seconds / SECONDS_PER_MINUTE)
    _write(page, Provenance(command, commit_of_code(), fingerprint(command, facts), minutes=minutes))


def is_honest(page: Path, facts: Mapping[str, Facts]) -> bool:
    """Whether the page has a line, and its recipe is that of the code, or it says that it is not.

    Args:
        facts: of studies by the names of their parts.
    """
    found = provenance_of(page.read_text(encoding="utf-8"))
    return found is not None and found.stale != _is_current(found, facts)


def mark(page: Path, facts: Mapping[str, Facts]) -> Provenance:
    """Make the page honest and return its line: whether it is stale is written anew, a missing line is put together.

    Without a line, the command is the first on the page, and the commit the last one that changed the page's figures:
    its CSV where it has one.

    Args:
        facts: as for `is_honest`.
    """
    text = page.read_text(encoding="utf-8")
    found = provenance_of(text)
    if found is None:
        command = _COMMAND.search(text)
        table = page.with_suffix(".csv")
        figures = table if table.exists() else page
        commit = _git("log", "-1", "--format=%h", "--", str(figures.resolve())) or UNRECORDED
        found = Provenance(command[1] if command else UNRECORDED, commit, UNRECORDED)
    found = replace(found, stale=not _is_current(found, facts))
    _write(page, found)
    return found


def commit_of_code() -> str:
    """The commit that is checked out; `UNRECORDED` outside a checkout.

    It has a plus where tracked files differ, other than documents: pages are written while a study goes on.
    """
    commit = _git("rev-parse", "--short", "HEAD")
    if not commit:
        return UNRECORDED
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs", ":!*.md")
    return commit + ("+" if changed else "")


def _is_current(found: Provenance, facts: Mapping[str, Facts]) -> bool:
    return found.part in facts and found.recipe == fingerprint(found.command, facts[found.part])


def _write(page: Path, line: Provenance) -> None:
    text = page.read_text(encoding="utf-8")
    if _LINE.search(text):
        text = _LINE.sub(lambda _: str(line), text, count=1)
    else:
        title, _, rest = text.partition("\n")
        text = f"{title}\n\n{line}\n\n{rest.lstrip()}"
    page.write_text(text, encoding="utf-8")


def _git(*arguments: str) -> str:
    """What git says, or "" where there is no git or no checkout."""
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _canonical(value: Any) -> Any:
    """A value as JSON that is the same in every process and on every machine."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, type) or (callable(value) and hasattr(value, "__qualname__")):
        return value.__qualname__
    if is_dataclass(value):
        return [type(value).__name__, {field.name: _canonical(getattr(value, field.name)) for field in fields(value)}]
    if isinstance(value, Mapping):
        return sorted(([_canonical(key), _canonical(item)] for key, item in value.items()), key=repr)
    if isinstance(value, set | frozenset):
        return sorted((_canonical(item) for item in value), key=repr)
    if isinstance(value, list | tuple):
        return [_canonical(item) for item in value]
    if isinstance(value, np.ndarray):
        return _canonical(value.tolist())
    if isinstance(value, partial):
        return [_canonical(value.func), _canonical(value.args), _canonical(value.keywords)]
    if isinstance(value, Path):
        return value.name
    return [type(value).__name__, _canonical(vars(value)) if hasattr(value, "__dict__") else ""]
