"""Speed against accuracy: what is tried, how it is marked, and the page."""

import csv
import math

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.scripts.benchmarks.studies.pareto import (
    DEFAULT,
    PEER,
    SERIES,
    consistent_contrast,
    few_variants,
    means_over_seeds,
    pareto_front,
    points_of,
    variants,
    with_fronts,
    write_pareto,
)
from cvdgs.scripts.benchmarks.studies.recipe import Recipe, Trial, described


def point(label: str, seconds: float, psnr: float, series: str = "steps", **more) -> pd.DataFrame:
    figures = {"gaussians": 1000, "psnr": psnr, "geometry_seconds": seconds}
    if series != PEER:
        figures |= {"ccpr": 0.8, "rwe": 0.9, "enhance_seconds": 1.0, "layer_seconds": 1.0}
    trial = Trial(**{**described("room", Recipe(label, iterations=100)), **figures, **more})
    return points_of([trial], [series], [320])


def test_every_choice_is_varied_and_every_default_is_there():
    tried = variants(480, 600, ["draft", "fine"])
    assert {variant.series for variant in tried} == {*SERIES, DEFAULT}
    labels = [variant.recipe.label for variant in tried]
    assert len(set(labels)) == len(labels)
    by_label = {variant.recipe.label: variant for variant in tried}
    assert (by_label["draft"].fitted_size, by_label["fine"].fitted_size) == (320, 480)
    assert by_label["fine"].recipe.iterations == 7000


@pytest.mark.parametrize("choose", [variants, few_variants], ids=["all", "few"])
def test_nothing_is_fitted_to_more_than_it_is_judged_by(choose):
    assert all(variant.fitted_size <= 240 for variant in choose(240, 600, ["draft", "fine"]))


def test_the_fronts_hold_what_nothing_beats_in_less_time():
    dear, cheap, beaten = point("dear", 20.0, 30.0), point("cheap", 5.0, 27.0), point("beaten", 10.0, 26.0)
    marked = with_fronts(pd.concat([dear, beaten, cheap]))
    assert marked.label.tolist() == ["cheap", "beaten", "dear"]
    assert marked.leads_psnr.tolist() == [True, False, True]


@given(st.floats(0.0, 1.0), st.floats(0.0, 3.0))
def test_consistent_contrast_stays_between_nothing_and_the_contrast(ccpr: float, rwe: float):
    assert 0.0 <= consistent_contrast(ccpr, rwe) <= ccpr


def test_a_scene_that_contradicts_itself_more_than_photographs_scores_nothing_whatever_its_contrast():
    assert consistent_contrast(0.9, 1.2) == consistent_contrast(0.5, 1.2) == 0.0
    assert math.isnan(consistent_contrast(0.9, math.nan))


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    points = [
        point("200 steps", 5.0, 27.0),
        point("400 steps", 10.0, 29.0),
        point("draft", 12.0, 28.0, DEFAULT),
        point("fine", 90.0, 31.0, DEFAULT),
        point("OpenSplat, full resolution", 200.0, 28.0, PEER),
        point("broken", math.nan, math.nan, error="InputError: too few views"),
    ]
    text = write_pareto(folder, pd.concat(points), base="a base", size=480, processes=2)
    return folder, text


def test_the_page_says_how_many_runs_shared_the_machine(page):
    _, text = page
    assert "Times are wall seconds of runs, up to 2 of them at a time;" in text


def test_the_page_says_which_defaults_are_beaten_and_by_what(page):
    _, text = page
    draft = next(line for line in text.splitlines() if line.startswith("- **draft**"))
    assert "Dominated in PSNR by *400 steps* (10 s, 1.00 dB more)" in draft
    fine = next(line for line in text.splitlines() if line.startswith("- **fine**"))
    assert "On the PSNR front." in fine


def test_the_page_names_the_programs_that_ran_beside_and_the_failures(page):
    _, text = page
    assert "Measured in the same call: OpenSplat." in text
    assert "broken: InputError: too few views" in text


def test_the_table_marks_the_front_and_has_no_column_for_deviations_of_single_runs(page):
    _, text = page
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]
    front = {row[1] for row in rows if row[-1].startswith("PSNR")}
    assert front == {"200 steps", "400 steps", "fine"}
    assert "±" not in rows[0]


def test_a_point_is_the_mean_of_its_seeds_and_says_how_far_they_are_apart(tmp_path):
    runs = [
        point("400 steps", 10.0, 29.0, seed=0),
        point("400 steps", 14.0, 30.0, seed=1),
        point("200 steps", 5.0, 27.0),
    ]
    failed = point("400 steps", math.nan, math.nan, seed=2, error="InputError: too few views")
    short, long = means_over_seeds(pd.concat([*runs, failed])).sort_values("psnr").itertuples()
    assert (long.psnr, long.geometry_seconds, long.error) == (29.5, 12.0, "InputError: too few views")
    assert long.psnr_deviation == pytest.approx(0.5**0.5)
    assert (short.psnr, short.error) == (27.0, "")
    assert math.isnan(short.psnr_deviation)
    text = write_pareto(tmp_path, pd.concat([*runs, failed]), base="a base", size=480)
    assert "Points are the means of 3 seeds" in text
    assert "| 29.50 | 0.71 |" in text
    with open(tmp_path / "pareto.csv", encoding="utf-8") as file:
        assert sum(row["label"] == "400 steps" for row in csv.DictReader(file)) == 3


def test_table_and_chart_stand_beside_the_page(page):
    folder, _ = page
    with open(folder / "pareto.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["series"] for row in rows} == {"steps", DEFAULT, PEER}
    for name in ("pareto.svg", "pareto-dark.svg", "pareto.png", "pareto-dark.png"):
        assert (folder / name).stat().st_size > 1000
    chart = (folder / "pareto.svg").read_text(encoding="utf-8")
    assert all(word in chart for word in ("draft", "fine", "Pareto front", "other programs"))


# Few different values, so that equal costs and values come up often.
figures = st.lists(st.tuples(st.integers(0, 6).map(float), st.integers(0, 6).map(float)), max_size=30)


def dominates(first: tuple[float, float], second: tuple[float, float]) -> bool:
    return first[0] <= second[0] and first[1] >= second[1] and first != second


@given(figures)
def test_the_front_is_what_nothing_dominates(points: list[tuple[float, float]]):
    front = pareto_front([cost for cost, _ in points], [value for _, value in points])
    undominated = {i for i, p in enumerate(points) if not any(dominates(other, p) for other in points)}
    assert set(front) == undominated
    assert len(front) == len(undominated)


@given(figures)
def test_the_front_goes_from_cheap_to_dear(points: list[tuple[float, float]]):
    front = pareto_front([cost for cost, _ in points], [value for _, value in points])
    assert [points[i] for i in front] == sorted(points[i] for i in front)


def test_what_was_not_measured_takes_no_part():
    assert pareto_front([1.0, 2.0, math.nan, 0.5], [5.0, math.nan, 9.0, 3.0]) == [3, 0]


@pytest.mark.parametrize("points", [[], [(1.0, 2.0)]], ids=["none", "one"])
def test_few_points_are_their_own_front(points):
    assert pareto_front([p[0] for p in points], [p[1] for p in points]) == list(range(len(points)))
