"""The number of Gaussians: verdicts on known runs, and the page."""

import csv

import pytest

from cvdgs.core.evaluate.studies.budget import BudgetRun, judge
from cvdgs.core.evaluate.studies.budget_page import write_budget

# 1 dB a doubling up to 4000 Gaussians, nothing beyond: the knee is a tenth of a doubling before.
FIXED = {1000: 28.0, 2000: 29.0, 4000: 30.0, 8000: 30.0, 16000: 30.0}


def run(gaussians: int, psnr: float, *, limit: int = 0, capture: str = "room") -> BudgetRun:
    return BudgetRun(capture, limit, gaussians, psnr, 0.8, 0.9, 10.0, 18.0, 600, "growth paid", "")


def runs_with_auto(gaussians: int, psnr: float, capture: str = "room") -> list[BudgetRun]:
    fixed = [run(size, value, limit=size, capture=capture) for size, value in FIXED.items()]
    return [run(gaussians, psnr, capture=capture), *fixed]


def test_a_run_at_the_knee_reaches_the_plateau_and_is_lean():
    (verdict,) = judge(runs_with_auto(4200, 29.95))
    assert verdict.plateau == 30.0
    assert verdict.reaches_plateau
    assert verdict.is_lean
    assert (verdict.half, verdict.twice) == (pytest.approx(29.07, abs=0.01), 30.0)


def test_a_run_that_stopped_too_early_is_behind():
    (verdict,) = judge(runs_with_auto(2000, 29.0))
    assert verdict.behind == pytest.approx(1.0)
    assert not verdict.reaches_plateau
    assert verdict.is_lean


def test_a_run_that_grew_too_long_is_not_lean():
    (verdict,) = judge(runs_with_auto(8000, 30.0))
    assert verdict.reaches_plateau
    assert not verdict.is_lean


def test_every_capture_is_judged_by_its_own_runs():
    verdicts = judge([*runs_with_auto(4000, 30.0), *runs_with_auto(2000, 29.0, "hall")])
    assert [(verdict.capture, verdict.reaches_plateau) for verdict in verdicts] == [("room", True), ("hall", False)]


def test_a_capture_without_fixed_runs_gets_no_verdict():
    assert judge([run(4000, 30.0)]) == []


def test_the_page_says_by_how_much_the_target_was_missed(tmp_path):
    runs = [*runs_with_auto(4000, 30.0), *runs_with_auto(2000, 29.0, "hall")]
    text = write_budget(tmp_path, runs, ["By `the command`."])
    room, hall = (line for line in text.splitlines() if line.startswith("- **"))
    assert "target reached: auto is on the plateau with 1.07 times the knee's Gaussians" in room
    assert "target missed: auto is 1.00 dB below the plateau" in hall
    with open(tmp_path / "budget.csv", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(runs)
    assert "fixed limits" in (tmp_path / "budget.svg").read_text(encoding="utf-8")
