"""The race to a peer's quality: read off the curves, and what ran before a break is not run again."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmark import main
from cvdgs.scripts.benchmarks.studies import race as study
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder
from cvdgs.scripts.benchmarks.studies.peers import Point, opensplat_runs
from cvdgs.scripts.benchmarks.studies.race import Finish, FinishStore, peer_finishes, race, write_peers

from .test_peers import stand_in  # noqa: F401
from .test_trials import capture_of_a_wall


def finish(label: str, *curve: tuple[float, float]) -> Finish:
    points = tuple(Point(*point) for point in curve)
    return Finish("room", label, 500, curve[-1][1], 50.0, curve[-1][0], 9000, points)


RUNS = opensplat_runs()
# Its best is not its end.
PEER = finish("OpenSplat", (40.0, 23.0), (90.0, 25.0), (170.0, 24.5))


def test_the_time_is_that_of_the_first_measurement_that_reaches_the_best_of_the_peer():
    (equal,) = race(PEER, [finish("ours", (2.0, 24.0), (9.0, 25.1), (20.0, 27.0))])
    assert (equal.psnr, equal.processor_seconds, equal.our_seconds, equal.times) == (25.0, 90.0, 9.0, 10.0)


def test_a_run_that_never_reaches_the_peer_has_a_dash(tmp_path: Path):
    ours = replace(finish("ours", (2.0, 24.0), (20.0, 24.9)), decided_on_held_out=True)
    equals = race(PEER, [ours])
    assert math.isnan(equals[0].our_seconds)
    text = write_peers(tmp_path, [PEER, ours], equals, ["By `a command`."])
    (row,) = (line for line in text.splitlines() if "| ours |" in line and "OpenSplat" in line)
    assert [cell.strip() for cell in row.split("|")[-3:-1]] == ["–", "–"]
    assert "aligned with its scene by their photographs; a peer's never are" in " ".join(text.split())
    assert "slightly optimistic: room (1 of 2 runs)." in text
    assert "OpenSplat" in (tmp_path / "peers.svg").read_text(encoding="utf-8")


def test_a_peer_that_ran_in_an_earlier_call_is_not_run_again(tmp_path: Path, stand_in: Path):  # noqa: F811
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    source = CaptureFolder("wall", tmp_path / "wall", 96)
    asked = (stand_in, source)
    first = peer_finishes(*asked, FinishStore(tmp_path / "work" / "peers.jsonl"), Reporter(), RUNS)
    again = peer_finishes(*asked, FinishStore(tmp_path / "work" / "peers.jsonl"), Reporter(), RUNS)
    assert [finish.label for finish in first] == [f"OpenSplat 1.2.0, {run.label}" for run in RUNS]
    assert again == first
    assert len((tmp_path / "arguments").read_text(encoding="utf-8").splitlines()) == len(RUNS)
    with pytest.raises(InputError, match="cannot be run"):
        peer_finishes(tmp_path / "gone", source, FinishStore(tmp_path / "other.jsonl"), Reporter(), RUNS)


def test_times_of_another_machine_are_not_compared_with(
    tmp_path: Path,
    stand_in: Path,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
):
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    asked = (stand_in, CaptureFolder("wall", tmp_path / "wall", 96), FinishStore(tmp_path / "peers.jsonl"), Reporter())
    for machine in ("one, 2 threads", "one, 2 threads", "other, 8 threads"):
        monkeypatch.setattr(study, "describe_processor", lambda machine=machine: machine)
        peer_finishes(*asked, RUNS[:1])
    assert len((tmp_path / "peers.jsonl").read_text(encoding="utf-8").splitlines()) == 2


def test_a_race_that_was_broken_off_while_it_wrote_loses_that_training_alone(tmp_path: Path):
    path = tmp_path / "peers.jsonl"
    store = FinishStore(path)
    for key in ("one", "two"):
        store.get(key, lambda key=key: finish(key, (9.0, 25.0)))
    path.write_bytes(path.read_bytes()[:-5])
    made = []
    for key in ("one", "two", "two"):
        FinishStore(path).get(key, lambda key=key: made.append(key) or finish(key, (9.0, 25.0)))
    assert made == ["two"]


def test_the_command_needs_a_program_to_compare_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["peers", "--out", str(tmp_path)]) == 2
    assert "--opensplat" in capsys.readouterr().err
