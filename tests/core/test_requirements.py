"""The lists of what is installed: complete, exact, and each file known by its hash."""

from __future__ import annotations

import hashlib
import os
import re
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from cvdgs.core import environment
from cvdgs.core.errors import InputError
from cvdgs.core.events import Reporter
from cvdgs.scripts import lock_requirements

from .test_environment import shelf  # noqa: F401

ROOT = Path(__file__).resolve().parents[2]
LISTS = sorted(ROOT.glob("requirements*.txt"))
ENTRY = re.compile(r"^(\S+)==([^\s;]+).*", re.MULTILINE)


def entries(path: Path) -> dict[str, str]:
    """Package to its exact version."""
    return {canonicalize_name(name): version for name, version in ENTRY.findall(path.read_text(encoding="utf-8"))}


@pytest.mark.parametrize("path", LISTS, ids=lambda path: path.name)
def test_every_entry_is_exact_and_has_hashes(path):
    text = re.sub(r"^(#|-r ).*\n", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for entry in re.split(r"\n(?=\S)", text.strip()):
        first, *hashes = entry.split(" \\\n")
        assert ENTRY.fullmatch(first)
        assert hashes
        assert all(re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}", line) for line in hashes)


def test_the_lists_have_what_the_project_requires_within_its_bounds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    worker = entries(environment.REQUIREMENTS) | entries(environment.TORCH_REQUIREMENTS)
    everything = worker | entries(ROOT / "requirements-dev.txt") | entries(ROOT / "requirements-fuzz.txt")
    for text in project["dependencies"]:
        assert canonicalize_name(Requirement(text).name) in worker
    extras = [text for extra in project["optional-dependencies"].values() for text in extra]
    for requirement in map(Requirement, [*project["dependencies"], *extras]):
        if requirement.name != "cvdgs":
            assert everything[canonicalize_name(requirement.name)] in requirement.specifier, requirement


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
