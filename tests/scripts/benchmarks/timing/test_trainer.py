"""Trainings are timed to a quality and compared at equal quality."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cvdgs.core.capture.model import Capture
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.scripts.benchmarks.tables import frame_of
from cvdgs.scripts.benchmarks.timing import trainer as comparisons
from cvdgs.scripts.benchmarks.timing.runs import TrainedRun, at_quality, train_once
from cvdgs.scripts.benchmarks.timing.step import measure_steps, write_steps

from ....core.splats.training.test_trainer import photographs, wall


@pytest.fixture(scope="module")
def capture() -> Capture:
    scene = wall(300)
    views = tuple(replace(view, source=Path("wall")) for view in photographs(scene, 9))
    return Capture(Path("wall"), "test", views, scene.means, np.full((300, 3), 128, np.uint8))


def made(gaussians: int, psnr: float, seconds: float = 10.0, label: str = comparisons.OURS) -> TrainedRun:
    return TrainedRun("wall", label, 0, 100, gaussians, 0, psnr, seconds, seconds, "", ((seconds, psnr),))


def frame(*runs: TrainedRun) -> pd.DataFrame:
    return frame_of(TrainedRun, runs)


def test_a_training_is_measured_on_the_views_that_it_left_out(capture):
    run = train_once(capture, "short", TrainingPlan(steps=60, limit=400, sh_degree=0, stopping=None, curve_points=3))
    assert (run.capture, run.label, run.steps, run.sh_degree) == ("wall", "short", 60, 0)
    assert 0 < run.gaussians <= 400
    assert [seconds for seconds, _ in run.curve] == sorted(seconds for seconds, _ in run.curve)
    assert run.curve[-1][1] == run.psnr > run.curve[0][1]
    assert run.seconds_to(run.curve[0][1]) == run.curve[0][0]
    assert math.isnan(run.seconds_to(run.psnr + 20.0))


def test_the_first_time_counts_even_if_the_quality_is_lost_again():
    run = replace(made(100, 25.0), curve=((1.0, 20.0), (2.0, 26.0), (3.0, 25.0)))
    assert run.seconds_to(25.5) == 2.0


def test_equal_quality_is_read_between_two_sizes():
    runs = frame(made(10_000, 30.0, 10.0), made(40_000, 32.0, 30.0), made(20_000, 31.0, 20.0))
    found = at_quality(runs, 30.5)
    assert found.gaussians == pytest.approx(10_000 * math.sqrt(2.0))
    assert found.processor_seconds == pytest.approx(15.0)


def test_a_quality_that_none_reaches_has_no_price_and_one_that_all_reach_has_the_smallest():
    runs = frame(made(10_000, 30.0), made(20_000, 31.0))
    assert math.isnan(at_quality(runs, 33.0).gaussians)
    assert at_quality(runs, 29.0).gaussians == 10_000


def test_the_table_of_strategies_says_what_equal_quality_costs(tmp_path):
    reference = made(40_000, 31.0, 40.0, comparisons.REFERENCE)
    runs = [made(10_000, 30.0, 10.0), made(20_000, 31.0, 20.0), reference]
    text = comparisons.write_runs(tmp_path, "strategies", "Strategies", runs)
    assert "31.00 dB takes 0.50 of the Gaussians and 0.50 of the processor time" in text
    assert (tmp_path / "strategies.csv").read_text().count("\n") == 4
    assert "wall,multi-view,20000,20,31" in (tmp_path / "strategies_curves.csv").read_text()


def test_our_strategy_runs_with_every_limit_and_the_reference_with_the_largest(capture):
    runs = comparisons.compare_strategies(capture, 40, Reporter(), limits=(320, 360))
    assert [run.label for run in runs] == [comparisons.REFERENCE, comparisons.OURS, comparisons.OURS]
    assert runs[1].gaussians <= 320
    assert all(run.gaussians <= 360 for run in runs)


def test_seeds_spread_by_the_difference_of_the_extremes(capture, tmp_path):
    first, second = comparisons.compare_seeds(capture, 20, 2, Reporter())
    assert first.psnr != second.psnr
    text = comparisons.write_runs(tmp_path, "seeds", "Seeds", [first, second])
    assert f"smallest PSNR: {abs(first.psnr - second.psnr):.2f} dB" in text


def test_a_quality_that_is_never_reached_has_a_dash_for_its_time(capture, tmp_path):
    found = comparisons.time_to_quality(capture, 1, 1, Reporter())  # 300 Gaussians do not get as far
    assert "| 1 | – |" in comparisons.write_time_to_quality(tmp_path, capture, found)


def test_a_step_is_timed_round_by_round_and_beside_a_busy_process(capture, tmp_path):
    figures = measure_steps(capture, 2, 1, steps=12)
    assert len(figures.rounds) == 2
    assert min(figures.beside_ms, *figures.rounds) > 0.0
    assert "300 Gaussians; medians of 2 runs of 12 steps" in write_steps(tmp_path, capture, figures)
    assert (tmp_path / "step.csv").read_text().startswith("round,step_ms")
