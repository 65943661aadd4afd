"""Scaling over workers: the law is found from what follows it, and the page says where it ends."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from cvdgs.scripts.benchmarks.timing.throughput import (
    DASK,
    LEAST_GAIN,
    LOCAL,
    Scalability,
    fit_scalability,
    throughputs,
    write_throughput,
)

COUNTS = (1, 2, 4, 8)


@pytest.mark.parametrize(("serial", "crosstalk"), [(0.1, 0.01), (0.25, 0.0), (0.0, 0.02)])
def test_a_law_is_found_from_speedups_that_follow_it(serial: float, crosstalk: float):
    law = Scalability(LOCAL, serial, crosstalk)
    found = fit_scalability(LOCAL, {count: law.speedup(count) for count in COUNTS})
    assert (found.serial, found.crosstalk) == pytest.approx((serial, crosstalk), abs=1e-9)


def test_the_most_work_is_done_where_the_law_says():
    law = Scalability(LOCAL, 0.1, 0.01)
    assert law.best == pytest.approx(math.sqrt(0.9 / 0.01))
    assert max(law.speedup(count) for count in range(1, 100)) == pytest.approx(law.most, rel=1e-2)


def test_without_crosstalk_it_is_amdahl_s_law_whose_limit_is_never_reached():
    law = Scalability(LOCAL, 0.2, 0.0)
    assert math.isnan(law.best)
    assert law.most == pytest.approx(5.0)
    assert law.speedup(1e6) == pytest.approx(5.0, rel=1e-3)


def test_beyond_the_workers_that_are_worth_it_each_adds_less_than_a_tenth():
    law = Scalability(LOCAL, 0.25, 0.0)
    assert law.speedup(law.worth) - law.speedup(law.worth - 1) >= LEAST_GAIN
    assert law.speedup(law.worth + 1) - law.speedup(law.worth) < LEAST_GAIN
    assert math.isinf(Scalability(LOCAL, 0.0, 0.0).worth)


def test_two_numbers_of_workers_determine_contention_alone():
    found = fit_scalability(LOCAL, {1: 1.0, 2: 1.6})
    assert (found.serial, found.crosstalk) == pytest.approx((0.25, 0.0))


def test_one_worker_tells_nothing_about_more():
    law = fit_scalability(LOCAL, {1: 1.0})
    assert all(map(math.isnan, (law.most, law.best, law.worth)))


def test_workers_that_help_more_than_they_can_share_nothing():
    assert fit_scalability(LOCAL, {1: 1.0, 2: 2.1}).serial == 0.0


def test_the_page_fits_no_more_workers_than_there_are_cores(tmp_path: Path):
    seconds = {(LOCAL, 1): [9.0, 10.0, 11.0], (LOCAL, 2): [6.25], (LOCAL, 4): [6.25], (DASK, 1): [12.0]}
    found = throughputs(seconds, 20)
    assert [one.rate for one in found[:2]] == pytest.approx([2.0, 3.2])
    assert [one.speedup for one in found[:2]] == pytest.approx([1.0, 1.6])
    text = write_throughput(tmp_path, found, frames=20, size=(480, 360), rounds=3, cores=2)
    assert "| local | 0.250 | 0.0000 | 8 | 2.9 | 4.0 |" in text
    assert "- local, by the model on as many cores: 4 workers 2.3 times" in text
    assert (tmp_path / "throughput.csv").is_file()
    assert "nothing shared" in (tmp_path / "throughput.svg").read_text(encoding="utf-8")
