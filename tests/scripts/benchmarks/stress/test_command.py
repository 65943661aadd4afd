"""`benchmark.py stress` as its users start it."""

from __future__ import annotations

import argparse
import csv
import math
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.errors import InputError
from cvdgs.scripts.benchmarks.stress.command import PART

BENCHMARK = ROOT / "scripts" / "benchmark.py"


def options(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    PART.add_arguments(parser)
    return parser.parse_args(arguments)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--axes", "views,weather"), "unknown axis 'weather'"),
        (("--levels", "1"), "1 is out of range"),
        (("--levels", "6"), "6 is out of range"),
        (("--real", f"a={ROOT}", "--processes", "3"), "--processes: it has no meaning with --real"),
        (("--real", f"a={ROOT}", "--axes", "views"), "--axes: it has no meaning with --real"),
    ],
)
def test_what_cannot_be_tried_is_refused_in_a_line(arguments: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        PART.measure(options(*arguments))


def stress(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(BENCHMARK), "stress", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=1200)


@pytest.mark.slow
def test_a_quick_run_writes_everything_and_goes_on_where_it_was(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    done = stress("--quick", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    written = {path.name for path in tmp_path.iterdir()}
    assert {"stress.csv", "stress.md", "stress.svg", "stress-dark.svg", "stress.png", "stress.html"} <= written
    with open(tmp_path / "stress.csv", encoding="utf-8") as file:
        rows = {(row["axis"], row["level"], row["method"]): row for row in csv.DictReader(file)}
    assert len(rows) == 3 * 4
    assert all(math.isfinite(float(row[name])) for row in rows.values() for name in ("psnr", "rwe", "ccpr"))
    drifting = {method: float(rows["drift", "3", method]["rwe"]) for method in ("layers", "post")}
    assert drifting["layers"] < drifting["post"]
    trials = (tmp_path / "work" / "trials.jsonl").read_bytes()
    assert stress("--quick", "--out", str(tmp_path)).returncode == 0
    assert (tmp_path / "work" / "trials.jsonl").read_bytes() == trials
