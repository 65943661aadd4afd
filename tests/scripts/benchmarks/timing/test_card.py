"""Trainings on a graphics card are told apart by when they reach the same quality."""

from __future__ import annotations

import pandas as pd
import pytest
import warp as wp

from cvdgs.core.errors import InputError
from cvdgs.scripts.benchmarks.timing import card
from cvdgs.scripts.benchmarks.timing.gsplat_peer import DEFAULT, MCMC, Gsplat, GsplatRun
from cvdgs.scripts.benchmarks.timing.runs import TrainedRun

PEER = GsplatRun(DEFAULT, 5000).label
SMALL_PEER = GsplatRun(MCMC, 5000, 20_000).label


def trained(label: str, *curve: tuple[float, float], capture: str = "vase") -> TrainedRun:
    seconds, psnr = curve[-1]
    return TrainedRun(capture, label, 0, 5000, 20_000, 0, psnr, seconds, seconds, "", curve)


OURS = trained(card.OURS, (2.0, 25.0), (4.0, 30.0), (5.0, 29.5))
RUNS = [OURS, trained(PEER, (4.0, 26.0), (12.0, 31.0)), trained(SMALL_PEER, (9.0, 28.0))]
STEP = card.Step("20,000 of SH degree 0, 480x360", card.OURS, 0.7, 0.2, 0.2, 0.1, 1.2)


def test_where_the_peer_ends_better_it_is_asked_when_it_had_our_best():
    (line,) = card.seconds_to_equal(RUNS)
    assert line == "- vase: 30.00 dB after 4.0 s, gsplat, default after 12.0 s: 3.0 times as long."


def test_where_ours_ends_better_it_is_asked_when_ours_had_the_best_of_the_peers():
    (line,) = card.seconds_to_equal([OURS, trained(PEER, (4.0, 24.0), (12.0, 25.0)), trained(SMALL_PEER, (9.0, 23.0))])
    assert line == "- vase: 25.00 dB after 2.0 s, gsplat, default after 12.0 s: 6.0 times as long."


def test_nothing_is_compared_without_a_peer():
    assert card.seconds_to_equal([OURS]) == []


def test_the_page_and_its_tables_have_every_training(tmp_path):
    runs = [*RUNS, trained(card.OURS, (1.0, 20.0), capture="room")]
    page = card.write_card(tmp_path, "cuda: a card", [STEP], runs, [])
    assert page.count("| vase |") == 3
    assert page.count("| room |") == 1
    assert "Whole runs" not in page
    assert len(pd.read_csv(tmp_path / "cuda.csv")) == 4
    assert list(pd.read_csv(tmp_path / "cuda_curves.csv").groupby("capture").size()) == [1, 6]
    assert pd.read_csv(tmp_path / "cuda_steps.csv").step.tolist() == [1.2]
    assert (tmp_path / "cuda.svg").is_file()


def test_whole_runs_are_listed_where_there_are_any(tmp_path):
    run = card.WholeRun("vase", "640x480", 40, "cuda", 31.0, 20_000, 12.0, 40.0)
    page = card.write_card(tmp_path, "cuda: a card", [STEP], RUNS, [run])
    assert "| vase | 640x480 | 40 | cuda | 31.00 | 20000 | 12.0 | 40.0 |" in page
    assert pd.read_csv(tmp_path / "cuda_runs.csv").total.tolist() == [40.0]


def test_a_peer_that_is_not_installed_is_named():
    with pytest.raises(InputError, match=r"gsplat: cannot be imported.* - install gsplat and fused-ssim"):
        Gsplat()


@pytest.mark.gpu
def test_steps_are_timed_on_both_devices():
    wp.init()
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    steps = card.measure_steps(None, [(500, 64, 48, 0)], card.Reporter())
    assert [step.who for step in steps] == [card.OURS, card.ON_PROCESSOR]
    assert all(step.step > 0.0 for step in steps)
