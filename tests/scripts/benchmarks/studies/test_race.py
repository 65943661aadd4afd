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
from cvdgs.scripts.benchmarks.studies.race import (
    Equal,
    Finish,
    FinishStore,
    over_seeds,
    peer_finishes,
    race,
    write_peers,
)

from .test_peers import stand_in  # noqa: F401
from .test_trials import capture_of_a_wall


def finish(label: str, *curve: tuple[float, float], seed: int = 0) -> Finish:
    points = tuple(Point(*point) for point in curve)
    return Finish("room", label, seed, 500, curve[-1][1], 50.0, curve[-1][0], 9000, points)


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


def races_of_three_seeds() -> list[Equal]:
    """Our run takes a ninth of the peer's 90 s, a third of them, and with the last seed never gets there."""
    reached = [[(10.0, 25.0)], [(30.0, 25.0)], [(40.0, 24.0)]]
    return [race(replace(PEER, seed=i), [finish("ours", *curve, seed=i)])[0] for i, curve in enumerate(reached)]


def test_several_seeds_are_medians_and_one_that_never_got_there_is_the_slowest():
    (row,) = over_seeds(races_of_three_seeds()).itertuples()
    assert (row.processor_seconds, row.our_seconds, row.times, row.most) == (90.0, 30.0, 3.0, 9.0)
    assert math.isnan(row.least)
    (mostly_never,) = over_seeds([races_of_three_seeds()[i] for i in (0, 2, 2)]).itertuples()
    assert math.isnan(mostly_never.our_seconds)
    assert math.isnan(mostly_never.times)


def test_the_page_of_several_seeds_has_the_range_of_ratios_and_the_deviations(tmp_path: Path):
    runs = [finish("ours", (9.0, psnr), seed=i) for i, psnr in enumerate((24.0, 25.0, 26.0))]
    text = write_peers(tmp_path, [PEER, *runs], races_of_three_seeds(), ["By `a command`."])
    assert "| room | OpenSplat | 25.00 | 90.0 | ours | 30.0 | 3.0 | – | 9.0 |" in text
    assert "| room | ours | 500 | 25.00 | 9.0 | 50.0 | 9000 |" in text
    assert "| room | ours | 500 | 1.00 | 0.0 | 0.0 | 0 |" in text.partition("Standard deviations")[2]


def test_a_peer_that_ran_in_an_earlier_call_is_not_run_again(tmp_path: Path, stand_in: Path):  # noqa: F811
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    source = CaptureFolder("wall", tmp_path / "wall", 96)
    asked = (stand_in, source)
    first = peer_finishes(*asked, FinishStore(tmp_path / "work" / "peers.jsonl"), Reporter(), RUNS)
    again = peer_finishes(*asked, FinishStore(tmp_path / "work" / "peers.jsonl"), Reporter(), RUNS)
    assert [finish.label for finish in first] == [f"OpenSplat 1.2.0, {run.label}" for run in RUNS]
    assert again == first
    repeated = peer_finishes(*asked, FinishStore(tmp_path / "work" / "peers.jsonl"), Reporter(), RUNS[:1], seed=1)
    assert [finish.seed for finish in repeated] == [1]
    assert len((tmp_path / "arguments").read_text(encoding="utf-8").splitlines()) == len(RUNS) + 1
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
