"""Captures of the real world: run as a user would, judged by fixed lines, drawn beside the axes, kept for resuming."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmark import main
from cvdgs.scripts.benchmarks.stress import real
from cvdgs.scripts.benchmarks.stress.heat_map import NAME as PICTURE
from cvdgs.scripts.benchmarks.stress.heat_map import read_standings, write_heat_map
from cvdgs.scripts.benchmarks.stress.real import RealCapture, margins_of_real, real_captures, run_real, write_real

EVIDENCE = ROOT / "docs" / "evidence"
GOOD = {"psnr": 31.0, "rwe": 0.7, "ccpr": 0.9, "ccpr_input": 0.6}


def report(*, psnr: float | None = 31.0, rwe: float = 0.7, ccpr: float = 0.9, warned: tuple[str, ...] = ()) -> dict:
    layer = {"rwe": {"ratio": rwe}, "ccpr": {"rendered": ccpr, "input": 0.6}}
    return {
        "capture": {"views": 12},
        "reconstruction": {"psnr": psnr},
        "layers": {"deutan-1.0": layer},
        "gaussians": 900,
        "warnings": [{"name": name, "message": ""} for name in warned],
    }


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for run.py: makes the report that the capture has for the seed, or refuses it; notes its calls."""
    script = tmp_path / "run.py"
    script.write_text(
        "import pathlib, shutil, sys\n"
        "capture, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[3])\n"
        f"open({str(tmp_path / 'calls')!r}, 'a').write(' '.join(sys.argv[1:]) + '\\n')\n"
        "report = capture / f'report-{sys.argv[-1]}.json'\n"
        "if not report.exists():\n"
        "    sys.stderr.write(f'run.py: {capture}: too few views\\n')\n"
        "    sys.exit(2)\n"
        "out.mkdir(parents=True)\n"
        "shutil.copy(report, out / 'report.json')\n",
        encoding="utf-8",
    )
    monkeypatch.setattr(real, "_SCRIPT", script)
    return tmp_path


def capture(folder: Path, name: str, *, seeds: tuple[int, ...] = (0,), **figures) -> RealCapture:
    place = folder / name
    place.mkdir(exist_ok=True)
    for seed in seeds:
        (place / f"report-{seed}.json").write_text(json.dumps(report(**figures)), encoding="utf-8")
    return RealCapture(name, place, holdout=7)


def test_each_line_fails_a_capture_and_a_refusal_is_quoted_without_its_folder(runs: Path) -> None:
    (runs / "none").mkdir()
    asked = [
        capture(runs, "good", warned=("few-views",)),
        capture(runs, "foggy", psnr=19.9),
        capture(runs, "torn", rwe=1.1),
        capture(runs, "grey", ccpr=0.5),
        capture(runs, "unknown", psnr=None),
        RealCapture("none", runs / "none"),
    ]
    found = run_real(asked, 240, 100, runs / "work", Reporter()).set_index("value")
    assert list(found.failed != "") == [False, True, True, True, True, True]
    assert found.warnings["good"] == "few-views"
    assert found.errors["none"] == "none: too few views"
    text = write_real(runs, found.reset_index(), 240, 100)
    assert "- none: none: too few views" in text


def test_the_means_of_the_seeds_decide_and_every_warning_is_kept(runs: Path) -> None:
    sharp = capture(runs, "grainy", seeds=(0, 1), psnr=20.5, warned=("few-views",))
    capture(runs, "grainy", seeds=(2,), psnr=19.3, warned=("few-views", "noise"))
    found = run_real([sharp], 240, 100, runs / "work", Reporter(), seeds=3).iloc[0]
    assert (found.seeds, found.failed, found.warnings) == (3, "", "few-views noise")
    assert (found.psnr, found.psnr_deviation) == (
        pytest.approx(20.1),
        pytest.approx(np.std([20.5, 20.5, 19.3], ddof=1)),
    )
    assert run_real([sharp], 240, 100, runs / "work", Reporter(), seeds=3).iloc[0].equals(found)
    assert len((runs / "calls").read_text(encoding="utf-8").splitlines()) == 3
    assert "means of 3 seeds" in write_real(runs, found.to_frame().T, 240, 100, 3)
    assert "Figures are of one seed." in write_real(runs, found.to_frame().T, 240, 100)


def test_a_figure_that_one_seed_could_not_measure_fails_the_capture(runs: Path) -> None:
    capture(runs, "unsure", seeds=(0, 2))
    asked = [capture(runs, "unsure", seeds=(1,), psnr=None)]
    found = run_real(asked, 240, 100, runs / "work", Reporter(), seeds=3).iloc[0]
    assert np.isnan(found.psnr)
    assert found.failed == "PSNR nan dB"


def test_a_capture_that_some_seeds_refuse_has_failed_and_keeps_the_figures_of_the_others(runs: Path) -> None:
    asked = [capture(runs, "sometimes", seeds=(1, 2))]
    found = run_real(asked, 240, 100, runs / "work", Reporter(), seeds=3).iloc[0]
    assert (found.seeds, found.psnr, found.failed) == (2, 31.0, "refused with 1 of 3 seeds")
    assert found.errors == "sometimes: too few views"


def test_a_run_that_was_made_before_is_made_again_for_other_settings_or_photographs_or_if_asked(runs: Path) -> None:
    def calls_of(iterations: int = 100, **how: bool) -> list[str]:
        run_real(asked, 240, iterations, runs / "work", Reporter(), **how)
        return (runs / "calls").read_text(encoding="utf-8").splitlines()

    asked = [capture(runs, "good")]
    (call,) = calls_of()
    assert "--holdout 7" in call
    assert len(calls_of()) == 1
    assert len(calls_of(200)) == 2
    assert len(calls_of(again=True)) == 3
    (asked[0].folder / "more.jpg").write_bytes(b"a photograph")
    assert len(calls_of()) == 4


def test_what_was_refused_is_tried_again_since_a_tool_may_have_been_missing(runs: Path) -> None:
    (runs / "late").mkdir()
    asked = [RealCapture("late", runs / "late"), capture(runs, "good")]
    assert list(run_real(asked, 240, 100, runs / "work", Reporter()).failed) == ["refused", ""]
    assert list(run_real(asked, 240, 100, runs / "work", Reporter()).failed) == ["refused", ""]
    assert len((runs / "calls").read_text(encoding="utf-8").splitlines()) == 3


@pytest.mark.parametrize(
    ("figures", "margin"), [({}, 1.0), ({"psnr": 25.0}, 0.5), ({"rwe": 0.95}, 0.25), ({"rwe": 2.0}, 0.0)]
)
def test_the_nearest_line_decides_how_far_a_capture_is_from_failing(figures, margin) -> None:
    assert margins_of_real(pd.DataFrame([{**GOOD, **figures}])).item() == pytest.approx(margin)


def test_a_capture_without_figures_has_no_margin() -> None:
    assert np.isnan(margins_of_real(pd.DataFrame([{**GOOD, "psnr": np.nan}])).item())


def test_they_are_in_the_picture_with_their_warnings(runs: Path) -> None:
    asked = [capture(runs, "good", warned=("few-views",)), capture(runs, "foggy", psnr=12.0)]
    write_real(runs, run_real(asked, 240, 100, runs / "work", Reporter()), 240, 100)
    write_heat_map(runs, read_standings([EVIDENCE / "stress.csv", runs / "stress-real.csv"]))
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", (runs / f"{PICTURE}.svg").read_text(encoding="utf-8"))
    assert {"good", "foggy × PSNR"} <= set(texts)


def test_a_capture_that_is_not_there_is_said_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert real_captures(f"here@7={tmp_path}") == (RealCapture("here", tmp_path, 7),)
    for words in ("nowhere=/nowhere", "unnamed", f"here@x={tmp_path}"):
        with pytest.raises(InputError):
            real_captures(words)
    assert main(["stress", "--out", str(tmp_path), "--real", "nowhere=/nowhere"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
