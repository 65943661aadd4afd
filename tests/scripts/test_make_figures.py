"""The figures of a run: drawn for the observer of its own simulation, and refused in a line where they cannot be."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cvdgs.core.files.images import write_png
from cvdgs.core.runs.layout import CAPTURE_FOLDER, ENHANCED_FOLDER, IMAGES_FOLDER, REPORT_FILE
from cvdgs.core.runs.report import SCHEMA

pytest.importorskip("matplotlib")
from cvdgs.scripts import make_figures

LAYER = "deutan-1.0"
ENTRY = {"seconds": 1.0, "psnr": 20.0, "gaussians": 500}
REPORT = {
    "schema": SCHEMA,
    "layers": {LAYER: {}},
    "views_shown": ["a"],
    "curve": [ENTRY],
    "settings": {"simulation": "vienot"},
}


def run_with(folder: Path, report: dict[str, Any]) -> Path:
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    for place in (folder / CAPTURE_FOLDER / IMAGES_FOLDER, folder / ENHANCED_FOLDER / LAYER):
        place.mkdir(parents=True)
        write_png(place / "a.png", picture)
    (folder / REPORT_FILE).write_text(json.dumps(report), encoding="utf-8")
    return folder


def test_colours_are_shown_by_the_simulation_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    simulate = make_figures.simulate
    monkeypatch.setattr(make_figures, "simulate", lambda image, *who: seen.append(who) or simulate(image, *who))
    assert make_figures.main([str(run_with(tmp_path, REPORT)), "--out", str(tmp_path)]) == 0
    assert set(seen) == {("deutan", 1.0, "vienot")}
    assert (tmp_path / "training.svg").is_file()


@pytest.mark.parametrize(
    ("report", "said"),
    [
        ({**REPORT, "curve": [{**ENTRY, "psnr": None}]}, "held no views out"),
        ({name: value for name, value in REPORT.items() if name != "curve"}, "not a finished run ('curve')"),
        ({**REPORT, "views_shown": []}, "not a finished run"),
        ({}, "report.json of the finished run is damaged"),
    ],
)
def test_a_run_without_a_curve_of_quality_is_refused(
    tmp_path: Path, report: dict[str, Any], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert make_figures.main([str(run_with(tmp_path, report)), "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
