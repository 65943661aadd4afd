"""The number of Gaussians: knees and verdicts of known runs, and the page."""

import csv
import math

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.scripts.benchmarks.studies.budget import ALLOWED, TOLERANCE, find_knee, judge, quality_at, write_budget

# 1 dB a doubling up to 4000 Gaussians, nothing beyond: the knee is a tenth of a doubling before.
FIXED = {1000: 28.0, 2000: 29.0, 4000: 30.0, 8000: 30.0, 16000: 30.0}


def run(gaussians: int, psnr: float, *, limit: int = 0, capture: str = "room", seed: int = 0) -> dict:
    known = {
        "seed": seed,
        "trial_seconds": 20.0,
        "ccpr": 0.8,
        "rwe": 0.9,
        "geometry_seconds": 10.0,
        "processor_seconds": 18.0,
        "peak_memory_mb": 600,
    }
    said = {"decision": "growth paid", "decided_on_held_out": False, "error": ""}
    return {"capture": capture, "limit": limit, "gaussians": gaussians, "psnr": psnr, **known, **said}


def runs_with_auto(gaussians: int, psnr: float, capture: str = "room", seed: int = 0) -> pd.DataFrame:
    fixed = [run(size, value, limit=size, capture=capture, seed=seed) for size, value in FIXED.items()]
    return pd.DataFrame([run(gaussians, psnr, capture=capture, seed=seed), *fixed])


def verdict_of(gaussians: int, psnr: float) -> pd.Series:
    return judge(runs_with_auto(gaussians, psnr)).iloc[0]


def test_a_run_at_the_knee_reaches_the_plateau_and_is_lean():
    verdict = verdict_of(4200, 29.95)
    assert verdict.plateau == 30.0
    assert verdict.behind <= TOLERANCE
    assert verdict.times_knee <= ALLOWED
    assert (verdict.half, verdict.twice) == (pytest.approx(29.07, abs=0.01), 30.0)


def test_a_run_that_stopped_too_early_is_behind():
    verdict = verdict_of(2000, 29.0)
    assert verdict.behind == pytest.approx(1.0)
    assert verdict.times_knee <= ALLOWED


def test_a_run_that_grew_too_long_is_not_lean():
    verdict = verdict_of(8000, 30.0)
    assert verdict.behind <= TOLERANCE
    assert verdict.times_knee > ALLOWED


def test_every_capture_is_judged_by_its_own_runs():
    verdicts = judge(pd.concat([runs_with_auto(4000, 30.0), runs_with_auto(2000, 29.0, "hall")]))
    assert dict(zip(verdicts.capture, verdicts.behind, strict=True)) == {"room": 0.0, "hall": 1.0}


def test_a_capture_without_fixed_runs_gets_no_verdict():
    assert judge(pd.DataFrame([run(4000, 30.0)])).empty


def test_the_page_says_by_how_much_the_target_was_missed(tmp_path):
    runs = pd.concat([runs_with_auto(4000, 30.0), runs_with_auto(2000, 29.0, "hall")])
    text = write_budget(tmp_path, runs, ["By `the command`."])
    assert "limits from 0.25 to 8 times what that took;" in text
    room, hall = (line for line in text.splitlines() if line.startswith("- **"))
    assert "target reached: auto is on the plateau with 1.07 times the knee's Gaussians" in room
    assert "target missed: auto is 1.00 dB below the plateau" in hall
    with open(tmp_path / "budget.csv", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(runs)
    assert "fixed limits" in (tmp_path / "budget.svg").read_text(encoding="utf-8")


def test_the_page_has_the_means_of_seeds_that_are_each_judged_by_their_own_runs(tmp_path):
    runs = pd.concat([runs_with_auto(4000, 30.0), runs_with_auto(2000, 29.0, seed=1)])
    assert judge(runs).behind.tolist() == [0.0, 1.0]
    text = write_budget(tmp_path, runs, ["By `the command`."])
    row, deviations = (line for line in text.splitlines() if line.startswith("| room |") and line.count("|") == 10)
    assert [cell.strip() for cell in row.split("|")[4:8]] == ["3000", "0.80", "29.50", "0.50"]
    assert deviations.split("|")[7].strip() == "0.71"


def test_the_page_names_the_captures_whose_held_out_views_decided_about_their_runs(tmp_path):
    few = runs_with_auto(4000, 30.0, "hall").assign(decided_on_held_out=[True] * 5 + [False])
    text = write_budget(tmp_path, pd.concat([runs_with_auto(4000, 30.0), few]), [])
    assert "slightly optimistic: hall (5 of 6 runs)." in text
    assert "optimistic" not in write_budget(tmp_path, runs_with_auto(4000, 30.0), [])


def runs_of(curve, sizes):
    return pd.DataFrame([{"gaussians": size, "psnr": curve(size), "processor_seconds": 1.0} for size in sizes])


SIZES = [1000, 1414, 2000, 2828, 4000, 5657, 8000, 11314, 16000]


def test_a_curve_that_rises_to_a_corner_has_its_knee_just_before_it():
    def rising(size):  # 1 dB a doubling up to 4000, nothing beyond
        return 30.0 + min(math.log2(size / 4000.0), 0.0)

    knee = find_knee(runs_of(rising, SIZES))
    assert knee.plateau == pytest.approx(30.0)
    assert knee.gaussians == pytest.approx(4000 * 2.0**-TOLERANCE, rel=1e-3)


def test_the_knee_of_an_ever_rising_curve_is_near_the_end():
    knee = find_knee(runs_of(lambda size: math.log2(size), SIZES))
    assert knee.gaussians == pytest.approx(16000 * 2.0**-TOLERANCE, rel=1e-3)


def test_a_scene_that_needs_no_more_than_the_least_has_its_knee_there():
    assert find_knee(runs_of(lambda size: 30.0, SIZES)).gaussians == SIZES[0]


def test_quality_that_falls_again_does_not_move_the_knee():
    falling = runs_of(lambda size: 30.0 - abs(math.log2(size / 4000.0)), SIZES)
    knee = find_knee(falling)
    assert knee.plateau == pytest.approx(30.0)
    assert knee.gaussians == pytest.approx(4000 * 2.0**-TOLERANCE, rel=1e-3)


@given(st.permutations(SIZES))
def test_the_order_of_the_runs_does_not_matter(sizes):
    assert find_knee(runs_of(math.log2, sizes)) == find_knee(runs_of(math.log2, SIZES))


def test_quality_between_runs_is_read_off_the_logarithm():
    runs = runs_of({1000: 28.0, 4000: 30.0}.get, [1000, 4000])
    assert quality_at(runs, 2000) == pytest.approx(29.0)
    assert quality_at(runs, 500) == 28.0
    assert quality_at(runs, 9000) == 30.0
