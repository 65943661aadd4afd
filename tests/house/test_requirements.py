"""The lists of what is installed: complete, exact, and each file known by its hash."""

from __future__ import annotations

import hashlib
import os
import re
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.errors import InputError
from cvdgs.core.runtime import environment
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts import install_requirements, lock_requirements

from ..core.runtime.test_environment import shelf  # noqa: F401

LISTS = sorted(ROOT.glob("requirements*.txt"))
ENTRY = re.compile(r"^(\S+)==([^\s;]+).*", re.MULTILINE)
Python = tuple[int, int]


def holds(requirement: Requirement, python: Python) -> bool:
    """Whether the requirement is one for this Python."""
    version = ".".join(map(str, python))
    asked_by = {"python_version": version, "python_full_version": f"{version}.0"}
    return requirement.marker is None or requirement.marker.evaluate(asked_by)


def entries(path: Path, python: Python) -> dict[str, str]:
    """Package to its exact version."""
    lines = [match[0].removesuffix(" \\") for match in ENTRY.finditer(path.read_text(encoding="utf-8"))]
    listed = [requirement for requirement in map(Requirement, lines) if holds(requirement, python)]
    assert len(listed) == len({requirement.name for requirement in listed})
    return {canonicalize_name(entry.name): str(entry.specifier).removeprefix("==") for entry in listed}


@pytest.mark.parametrize("path", LISTS, ids=lambda path: path.name)
def test_every_entry_is_exact_and_has_hashes(path):
    text = re.sub(r"^(#|-r ).*\n", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for entry in re.split(r"\n(?=\S)", text.strip()):
        first, *hashes = entry.split(" \\\n")
        assert ENTRY.fullmatch(first)
        assert hashes
        assert all(re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}", line) for line in hashes)


@pytest.mark.parametrize("python", environment.LISTED_PYTHONS)
def test_the_lists_have_what_the_project_requires_within_its_bounds(python):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    worker = entries(environment.REQUIREMENTS, python) | entries(environment.TORCH_REQUIREMENTS, python)
    everything = worker
    for path in (lock_requirements.DEVELOPMENT_REQUIREMENTS, lock_requirements.FUZZ_REQUIREMENTS):
        everything |= entries(path, python)
    for text in project["dependencies"]:
        assert canonicalize_name(Requirement(text).name) in worker
    extras = [text for extra in project["optional-dependencies"].values() for text in extra]
    for requirement in map(Requirement, [*project["dependencies"], *extras]):
        if requirement.name != "cvdgs" and holds(requirement, python):
            assert everything[canonicalize_name(requirement.name)] in requirement.specifier, requirement


@pytest.mark.parametrize("python", environment.LISTED_PYTHONS)
def test_a_python_is_one_that_the_package_allows(python):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert ".".join(map(str, python)) in SpecifierSet(project["requires-python"])


def test_a_python_that_the_lists_are_not_for_is_told_which_are(monkeypatch, capsys):
    monkeypatch.setattr(sys, "version_info", (3, 99, 0))
    monkeypatch.setattr(sys, "argv", ["install_requirements.py"])
    assert install_requirements.main() == 2
    said = capsys.readouterr().err
    assert "the lists are not for Python 3.99" in said
    assert said.count("\n") == 1


def test_a_new_torch_is_refused_until_the_hash_of_its_build_for_cpus_is_known():
    (listed,) = re.findall(r"^torch==\S+", environment.TORCH_REQUIREMENTS.read_text(encoding="utf-8"), re.MULTILINE)
    lock_requirements.require_other_builds({listed: ""})
    with pytest.raises(InputError, match=r"torch==99\.0 is new here"):
        lock_requirements.require_other_builds({"torch==99.0 ; sys_platform == 'linux'": ""})


def test_no_list_names_a_server():
    assert not [path for path in LISTS if re.search(r"https?:|index-url|find-links", path.read_text(encoding="utf-8"))]


def test_a_build_that_is_not_a_listed_one_is_not_installed(tmp_path, shelf, monkeypatch):  # noqa: F811
    (pebble,) = shelf.iterdir()
    wheel = shelf / "torch-9.0+stone-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as file:
        for name in zipfile.ZipFile(pebble).namelist():
            text = zipfile.ZipFile(pebble).read(name).decode()
            changed = text.replace("pebble", "torch").replace("1.0\n", "9.0+stone\n", name.endswith("METADATA"))
            file.writestr(name.replace("pebble-1.0", "torch-9.0+stone").replace("pebble", "torch"), changed)
    requirements = tmp_path / "requirements.txt"
    requirements.write_text(f"torch==9.0 \\\n    --hash=sha256:{hashlib.sha256(pebble.read_bytes()).hexdigest()}\n")
    monkeypatch.setattr(environment, "TORCH_REQUIREMENTS", requirements)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)  # whatever is constrained on this machine
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(shelf))
    with pytest.raises(InputError, match="HASHES"):
        environment.make_environment(tmp_path / "environment", Reporter())
    assert not environment.is_complete(tmp_path / "environment")
