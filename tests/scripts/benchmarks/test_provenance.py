"""Every page of figures says by which recipe it was made, and says so where that is no longer the code's."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.pipeline.stages import Plans
from cvdgs.scripts.benchmark import PARTS, main
from cvdgs.scripts.benchmarks import provenance
from cvdgs.scripts.benchmarks.options import Part
from cvdgs.scripts.benchmarks.provenance import (
    STALE,
    UNRECORDED,
    Provenance,
    commit_of_code,
    enhanced_product,
    fingerprint,
    is_honest,
    mark,
    provenance_of,
    stamp,
    trained_product,
)
from cvdgs.scripts.benchmarks.stale import facts_of_parts, pages_of

PAGES = [page for folder in ("evidence", "enhancer") for page in pages_of(ROOT / "docs" / folder)]
COMMAND = "python scripts/benchmark.py table --out DIR"


@dataclass(frozen=True)
class Study:
    steps: int = 3
    share: float = 0.1
    names: tuple[str, ...] = ("a", "b")
    rule: object = partial(sorted, reverse=True)


def facts(study: Study = Study()) -> tuple:
    return (study, {"deutan": np.arange(3)}, Path("anywhere") / "capture", len)


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "table.md"
    path.write_text("# A table\n\n| a |\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT / "docs").as_posix())
def test_no_page_is_older_than_its_recipe_without_saying_so(page: Path) -> None:
    remedy = f"measure it anew, or python scripts/benchmark.py provenance --out {page.parent.relative_to(ROOT)}"
    assert is_honest(page, facts_of_parts()), remedy


@pytest.mark.parametrize("part", [part for part in PARTS if part.pages], ids=lambda part: part.name)
def test_a_page_that_was_just_made_is_current(part: Part, page: Path) -> None:
    assert part.shaped_by is not None
    stamp(page, f"python scripts/benchmark.py {part.name} --out DIR", part.shaped_by)
    assert is_honest(page, facts_of_parts())


def test_there_are_pages() -> None:
    assert len(PAGES) > 8


def test_a_page_has_its_line_behind_the_title(page: Path) -> None:
    stamp(page, COMMAND, facts)
    title, _, line, _, *rest = page.read_text(encoding="utf-8").splitlines()
    assert title == "# A table"
    assert line == str(Provenance(COMMAND, commit_of_code(), fingerprint(COMMAND, facts)))
    assert rest == ["| a |"]
    assert is_honest(page, {"table": facts})


def test_the_line_says_how_long_the_command_took(page: Path) -> None:
    stamp(page, COMMAND, facts, seconds=200.0)
    text = page.read_text(encoding="utf-8")
    assert f"at commit `{commit_of_code()}` in 3 minutes, recipe" in text
    assert provenance_of(text) == Provenance(COMMAND, commit_of_code(), fingerprint(COMMAND, facts), minutes=3)


def test_code_that_is_not_committed_shows_as_a_plus_and_a_changed_document_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, document = tmp_path / "code.py", tmp_path / "docs" / "page.md"
    document.parent.mkdir()
    for path in (code, document):
        path.write_text("first\n", encoding="utf-8")
    author = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    for words in (("init", "-q"), ("add", "."), (*author, "commit", "-qm", "Begin")):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    commit = commit_of_code()
    document.write_text("second\n", encoding="utf-8")
    assert commit_of_code() == commit
    assert not commit.endswith("+")
    code.write_text("second\n", encoding="utf-8")
    assert commit_of_code() == f"{commit}+"


def test_a_page_that_is_made_again_has_one_line(page: Path) -> None:
    stamp(page, COMMAND, facts)
    stamp(page, COMMAND + " --seeds 2", facts)
    assert page.read_text(encoding="utf-8").count("> Made by") == 1


@pytest.mark.parametrize("change", [{"steps": 4}, {"share": 0.2}, {"names": ("a",)}, {"rule": partial(sorted)}])
def test_any_constant_that_changes_makes_a_page_stale_until_it_says_so(page: Path, change: dict) -> None:
    stamp(page, COMMAND, facts)
    recorded = provenance_of(page.read_text(encoding="utf-8"))
    changed = {"table": lambda: facts(replace(Study(), **change))}
    assert not is_honest(page, changed)
    line = mark(page, changed)
    assert is_honest(page, changed)
    assert line == replace(recorded, stale=True)
    assert STALE in page.read_text(encoding="utf-8")
    # A page that says that it is stale, and is not, is no better.
    assert not is_honest(page, {"table": facts})
    mark(page, {"table": facts})
    assert provenance_of(page.read_text(encoding="utf-8")) == recorded


def test_a_command_that_was_changed_by_hand_is_another_recipe(page: Path) -> None:
    stamp(page, COMMAND, facts)
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("--out DIR", "--out DIR --seeds 3"), encoding="utf-8")
    assert not is_honest(page, {"table": facts})


def test_a_page_without_a_line_is_not_honest_and_gets_one(page: Path) -> None:
    page.write_text(f"# A table\n\nBy `{COMMAND}`: of 3 seeds.\n", encoding="utf-8")
    assert not is_honest(page, {"table": facts})
    line = mark(page, {"table": facts})
    assert (line.command, line.recipe, line.stale) == (COMMAND, UNRECORDED, True)


def test_a_constant_of_the_product_is_part_of_a_recipe(monkeypatch: pytest.MonkeyPatch) -> None:
    before = fingerprint(COMMAND, trained_product)
    plans = Plans(layer=replace(Plans().layer, epochs=Plans().layer.epochs + 1))
    monkeypatch.setattr("cvdgs.core.pipeline.stages.Plans", lambda: plans)
    assert fingerprint(COMMAND, trained_product) != before


@pytest.mark.parametrize(("revision", "enhanced_changes"), [("ENHANCEMENT", True), ("RECONSTRUCTION", False)])
def test_a_revision_is_part_of_the_recipes_that_depend_on_it(
    revision: str, enhanced_changes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    products = trained_product, enhanced_product
    trained, enhanced = (fingerprint(COMMAND, product) for product in products)
    monkeypatch.setattr(provenance, revision, getattr(provenance, revision) + 1)
    trained_then, enhanced_then = (fingerprint(COMMAND, product) for product in products)
    assert trained_then != trained
    assert (enhanced_then != enhanced) is enhanced_changes


def test_a_fingerprint_is_the_same_in_every_process() -> None:
    code = (
        "from cvdgs.scripts.benchmarks.provenance import fingerprint\n"
        "from cvdgs.scripts.benchmarks.stale import facts_of_parts\n"
        f"print(*(fingerprint({COMMAND!r}, facts) for facts in facts_of_parts().values()))\n"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.split() == [fingerprint(COMMAND, facts) for facts in facts_of_parts().values()]


def test_a_part_stamps_the_pages_that_it_wrote_and_no_other(tmp_path: Path) -> None:
    def measure(options: argparse.Namespace) -> str:
        (options.out / "made.md").write_text("# Made\n", encoding="utf-8")
        return "done"

    (tmp_path / "old.md").write_text("# Old\n", encoding="utf-8")
    part = Part("table", "summary", lambda parser: None, measure, ("made.md", "old.md", "none.md"), facts)
    assert part.run(argparse.Namespace(out=tmp_path), COMMAND) == "done"
    assert is_honest(tmp_path / "made.md", {"table": facts})
    assert (tmp_path / "old.md").read_text(encoding="utf-8") == "# Old\n"


def test_the_command_marks_the_pages_of_a_folder(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["provenance", "--out", str(page.parent)]) == 0
    assert capsys.readouterr().out == "table.md: stale\n"
    assert main(["provenance", "--out", str(page.parent / "empty")]) == 2
