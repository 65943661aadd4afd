"""The race to a peer's quality: read off our curves, and a peer that ran before is not run again."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmark import main
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder
from cvdgs.scripts.benchmarks.studies.peers import OPENSPLAT_RUNS
from cvdgs.scripts.benchmarks.studies.race import Finish, peer_finishes, race, write_peers
from cvdgs.scripts.benchmarks.timing.runs import TrainedRun

from .test_peers import stand_in  # noqa: F401
from .test_trials import capture_of_a_wall

PEER = Finish("room", "OpenSplat, full resolution", 500, 25.0, 90.0, 170.0, 9000)


def run_with(*curve: tuple[float, float]) -> TrainedRun:
    return TrainedRun("room", "ours", 0, 1000, 5000, 0, curve[-1][1], 40.0, 70.0, "", curve)


def test_the_time_is_that_of_the_first_measurement_that_reaches_the_peer():
    (equal,) = race(PEER, [run_with((2.0, 24.0), (9.0, 25.1), (20.0, 27.0))])
    assert (equal.our_seconds, equal.times) == (9.0, 10.0)


def test_a_run_that_never_reaches_the_peer_has_a_dash(tmp_path: Path):
    equals = race(PEER, [run_with((2.0, 24.0), (20.0, 24.9))])
    assert math.isnan(equals[0].our_seconds)
    text = write_peers(tmp_path, [PEER], equals)
    (row,) = (line for line in text.splitlines() if "| ours |" in line)
    assert [cell.strip() for cell in row.split("|")[-3:-1]] == ["–", "–"]


def test_a_peer_that_ran_in_an_earlier_call_is_not_run_again(tmp_path: Path, stand_in: Path):  # noqa: F811
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    source = CaptureFolder("wall", tmp_path / "wall", 96)
    first = peer_finishes(stand_in, source, tmp_path / "work", Reporter(), OPENSPLAT_RUNS)
    again = peer_finishes(tmp_path / "gone", source, tmp_path / "work", Reporter(), OPENSPLAT_RUNS)
    assert [finish.label for finish in first] == [f"OpenSplat, {run.label}" for run in OPENSPLAT_RUNS]
    assert again == first
    with pytest.raises(InputError, match="cannot be run"):
        peer_finishes(tmp_path / "gone", source, tmp_path / "other", Reporter(), OPENSPLAT_RUNS)


def test_the_command_needs_a_program_to_compare_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["peers", "--out", str(tmp_path)]) == 2
    assert "--opensplat" in capsys.readouterr().err
