"""The commands that the pages show are those that scripts/benchmark.py takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import EXIT_INPUT
from cvdgs.scripts.benchmark import PARTS, build_parser, main

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SPAN = re.compile(r"`([^`]*\bbenchmark\.py\b[^`]*)`|^ {4}(.*\bbenchmark\.py\b.*)$", re.MULTILINE)
PLACEHOLDER = "PART"


def commands() -> list[tuple[str, str]]:
    """The pages' paths and the arguments behind every ``benchmark.py``, where there are any."""
    found = []
    for page in PAGES:
        for span in SPAN.findall(page.read_text(encoding="utf-8")):
            _, _, arguments = " ".join("".join(span).split()).partition("benchmark.py")
            if arguments and PLACEHOLDER not in arguments.split():
                found.append((page.relative_to(ROOT).as_posix(), arguments.strip()))
    return list(dict.fromkeys(found))


@pytest.mark.parametrize(("page", "arguments"), commands())
def test_every_command_on_a_page_has_the_options_of_its_part(page: str, arguments: str) -> None:
    parts, *words = shlex.split(arguments)
    words = [word for word in words if word != "--help"]
    out = [] if "--out" in words else ["--out", "DIR"]
    for part in parts.split("|"):
        assert build_parser().parse_args([part, *words, *out]).measure


def test_the_pages_show_commands() -> None:
    assert len(commands()) > 20
    assert len({arguments.split()[0] for _, arguments in commands()}) > 8


def test_every_part_has_a_name_of_its_own_and_a_line_of_help() -> None:
    assert len({part.name for part in PARTS}) == len(PARTS)
    assert all(part.summary and "\n" not in part.summary for part in PARTS)


@pytest.mark.parametrize("arguments", [["tables"], ["table"], ["table", "--out", "DIR", "--seeds", "few"]])
def test_what_cannot_be_understood_is_refused(arguments: list[str]) -> None:
    with pytest.raises(InputError):
        build_parser().parse_args(arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        "budget --captures demo --processes 0",
        "table --quick --seeds 0",
        "step --rounds 0",
        "trainer --max-size -5",
        "pareto --captures ,",
        "stress --axes ,",
        "stress --seeds 0",
        "cost --sizes ''",
        "cost --views 5,0",
        "figure --views 1",
        "enhancer --cvd achromat",
        "enhancer --cvd unknown",
        "stress --redraw docs/evidence/stress-real.csv",
    ],
)
def test_what_cannot_be_measured_is_refused_in_a_line(
    arguments: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    assert main([*shlex.split(arguments), "--out", str(tmp_path)]) == EXIT_INPUT
    said = capsys.readouterr().err
    assert said.startswith("benchmark.py: ")
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())
