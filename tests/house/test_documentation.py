"""What the pages say exists: the files and headings they link to, the scripts, options and targets they name."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
LINK = re.compile(r'\]\(([^)\s]+)\)|\b(?:src|srcset|href)="([^"]+)"')


def links(page: Path) -> list[str]:
    """What the page links to within the repository."""
    found = [first or second for first, second in LINK.findall(page.read_text(encoding="utf-8"))]
    return [link for link in found if not re.match(r"[a-z]+:", link)]


def anchors(page: Path) -> set[str]:
    """The anchors of the page's headings, as forges make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pages
def test_links_lead_to_files_and_headings(page):
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), f"{link} is not there"
        assert not anchor or anchor in anchors(target), f"{link}: no such heading"


@pages
def test_scripts_and_targets_exist(page):
    text = page.read_text(encoding="utf-8")
    for script in re.findall(r"\bscripts/\w+\.(?:py|sh)\b", text):
        assert (ROOT / script).is_file(), script
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:`|^ {4})make ([a-z][a-z-]*)", text, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"make {target}"


def test_the_reference_lists_every_option_of_the_main_job_and_no_other():
    text = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
    section = text[text.index("## run.py") : text.index("`DIR` gets the results")]
    named = set(re.findall(r"^\| `(--[a-z-]+)", section, re.MULTILINE)) | {"--out"}
    help_text = subprocess.run(
        [sys.executable, ROOT / "scripts" / "run.py", "--help"], capture_output=True, text=True, check=True
    ).stdout
    offered = set(re.findall(r"^ +(--[a-z][a-z-]+)", help_text, re.MULTILINE))
    assert {option.replace("--no-", "--") for option in named} == offered


def test_the_readme_is_short():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 130
    assert len(text.encode()) <= 9000
