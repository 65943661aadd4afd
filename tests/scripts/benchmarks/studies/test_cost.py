"""Cost as work grows: exponents of known laws, captures of fewer views, and the page."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cvdgs.core.capture.normalised import write_capture
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder
from cvdgs.scripts.benchmarks.studies.cost import SomeViews, exponents, power_law, there_are, write_cost
from cvdgs.scripts.benchmarks.studies.recipe import Recipe, Trial, described, with_derived
from cvdgs.scripts.benchmarks.tables import frame_of

from .test_trials import capture_of_a_wall

AMOUNTS = [10.0, 20.0, 40.0, 80.0]


def test_a_law_without_noise_is_found_exactly():
    found = power_law(AMOUNTS, [3.0 * amount**0.7 for amount in AMOUNTS])
    assert found == pytest.approx((0.7, 0.7, 0.7))


def test_the_interval_holds_the_true_exponent_as_often_as_it_says():
    rng, held = np.random.default_rng(0), 0
    for _ in range(400):
        costs = np.power(AMOUNTS, 0.5) * np.exp(0.1 * rng.standard_normal(len(AMOUNTS)))
        _, low, high = power_law(AMOUNTS, costs)
        held += low <= 0.5 <= high
    assert 0.92 < held / 400 < 0.98


def test_what_does_not_grow_has_no_exponent_and_two_points_have_no_interval():
    assert all(map(math.isnan, power_law([10.0, 10.0], [1.0, 2.0])))
    exponent, low, high = power_law([10.0, 20.0], [1.0, 2.0])
    assert exponent == pytest.approx(1.0)
    assert math.isnan(low)
    assert math.isnan(high)


def test_some_views_are_spread_over_the_capture_and_known_apart(tmp_path: Path):
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    base = CaptureFolder("wall", tmp_path / "wall", 96)
    whole = base.load().given.views
    some = SomeViews(base, 3).load().given.views
    assert [view.key for view in some] == [whole[i].key for i in (0, 4, 7)]
    assert len(SomeViews(base, 99).load().given.views) == len(whole)
    assert SomeViews(base, 3).key != SomeViews(base, 4).key


def test_a_capture_is_not_asked_for_more_than_it_has(tmp_path: Path):
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    base = CaptureFolder("wall", tmp_path / "wall", 48)
    views = base.load().given.views
    camera = replace(base, max_size=9999).load().given.views[0].camera
    longer = max(camera.width, camera.height)
    counts, pixels = there_are(base, (4, 100, 200), (longer // 2, 5 * longer, 9 * longer))
    assert counts == [4, len(views)]
    area = camera.width * camera.height
    assert pixels == {longer // 2: pytest.approx(area / 4, rel=0.05), longer: area}


def trials() -> pd.DataFrame:
    """Time grows with the views and half as fast with the pixels, memory with neither; one trial failed."""
    trial = Trial(**described("room", Recipe("cost")), psnr=30.0, gaussians=900, peak_memory_mb=500)
    made = []
    for over, amounts, exponent in (("views", (10, 20, 40), 1.0), ("pixels", (14400, 57600, 230400), 0.5)):
        for amount in amounts:
            seconds = float(amount) ** exponent
            timed = ("geometry", "enhance", "layer", "processor", "trial")
            costs = {f"{name}_seconds": seconds for name in timed}
            made.append((over, amount, replace(trial, **costs, decided_on_held_out=amount == 10)))
    made.append(("views", 80, Trial.failed("room", Recipe("cost"), "it broke")))
    frame = frame_of(Trial, [trial for _, _, trial in made])
    return with_derived(frame.assign(over=[over for over, _, _ in made], amount=[amount for _, amount, _ in made]))


def test_each_figure_has_an_exponent_over_each_thing_that_grows():
    found = exponents(trials()).set_index(["over", "figure"]).exponent
    assert found["photographs", "geometry"] == pytest.approx(1.0)
    assert found["pixels of a photograph", "geometry"] == pytest.approx(0.5)
    assert found["photographs", "Gaussians"] == pytest.approx(0.0)


def test_further_seeds_of_the_same_amounts_make_no_interval_narrower():
    once = trials()
    bent = once.assign(geometry_seconds=once.geometry_seconds * np.where(once.amount == 20, 2.0, 1.0))
    found = [exponents(pd.concat([bent] * seeds)).set_index(["over", "figure"]) for seeds in (1, 3)]
    alone, repeated = (table.loc["photographs", "geometry"].drop("capture") for table in found)
    assert alone.high - alone.low > 1.0
    assert repeated.to_numpy() == pytest.approx(alone.to_numpy())


def test_the_page_has_tables_a_chart_and_what_failed(tmp_path: Path):
    text = write_cost(tmp_path, trials(), ["By `a command`."])
    assert "| room | photographs | geometry | 1.00 | 1.00 | 1.00 | 3 |" in text
    assert "## room: pixels of a photograph" in text
    assert "it broke" in text
    assert "slightly optimistic: room, 10 photographs (1 of 1 runs)." in text
    assert "photographs" in (tmp_path / "cost.svg").read_text(encoding="utf-8")
