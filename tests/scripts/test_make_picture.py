"""The README's picture from a run: four pictures in one, and a line where a folder does not have them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cvdgs.core.files.images import read_png, write_png
from cvdgs.core.runs.report import SCHEMA
from cvdgs.scripts.make_picture import GAP, main

LAYER = "deutan-1.0"
REPORT = {"schema": SCHEMA, "layers": {LAYER: {}}, "settings": {}, "views_shown": ["a", "b"]}
PLACES = ("capture/images", f"renders/{LAYER}", f"renders/{LAYER}/simulated_input", f"renders/{LAYER}/simulated")


def run_with(folder: Path, report: Any) -> Path:
    folder.mkdir()
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    for number, place in enumerate(PLACES):
        (folder / place).mkdir(parents=True, exist_ok=True)
        write_png(folder / place / "a.png", np.full((20, 30, 3), 50 * number, np.uint8))
    return folder


def test_the_four_pictures_of_a_view_lie_beside_and_below_each_other(tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    assert main([str(run_with(tmp_path / "run", REPORT)), "--out", str(out)]) == 0
    picture = read_png(out)
    assert picture.shape == (2 * 20 + GAP, 2 * 30 + GAP, 3)
    assert [picture[y, x, 0] for y in (0, -1) for x in (0, -1)] == [0, 50, 100, 150]


@pytest.mark.parametrize(
    ("report", "options", "said"),
    [
        ({}, [], "report.json of the finished run is damaged"),
        ([], [], "report.json of the finished run is damaged"),
        ({**REPORT, "layers": {}}, [], "its report names no pictures"),
        ({**REPORT, "views_shown": []}, [], "its report names no pictures"),
        ({**REPORT, "views_shown": None}, [], "report.json of the finished run is damaged"),
        (REPORT, ["--view", "c"], "no held-out view 'c' - use a, b"),
        (REPORT, ["--view", "b"], "b.png"),
        (REPORT, ["--views", "a"], "see --help"),
    ],
)
def test_a_run_without_them_and_wrong_options_are_refused_in_a_line(
    tmp_path: Path, report: Any, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.png"
    assert main([str(run_with(tmp_path / "run", report)), "--out", str(out), *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not out.exists()


def test_a_folder_without_a_run_is_refused_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path), "--out", str(tmp_path / "out.png")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "there is no finished run" in line
