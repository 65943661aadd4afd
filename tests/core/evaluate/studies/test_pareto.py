"""Speed against accuracy: what is tried, how it is marked, and the page."""

import csv
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.evaluate.studies.pareto import (
    DEFAULT,
    PEER,
    SERIES,
    Default,
    ParetoPoint,
    Variant,
    consistent_contrast,
    few_variants,
    variants,
    with_fronts,
)
from cvdgs.core.evaluate.studies.pareto_page import write_pareto
from cvdgs.core.evaluate.studies.peers import PeerFigures
from cvdgs.core.evaluate.studies.recipe import Recipe, Trial, described

DRAFT, FINE = Default("draft", 450, 320), Default("fine", 7000, 960)


def point(label: str, seconds: float, psnr: float, series: str = "steps", **more) -> ParetoPoint:
    recipe = Recipe(label, iterations=100)
    trial = Trial(
        **described("room", recipe),
        gaussians=1000,
        psnr=psnr,
        ccpr=0.8,
        rwe=0.9,
        geometry_seconds=seconds,
        enhance_seconds=1.0,
        layer_seconds=1.0,
        **more,
    )
    return ParetoPoint.of_trial(Variant(series, recipe, 320), trial)


def test_every_choice_is_varied_and_every_default_is_there():
    tried = variants(480, 600, [DRAFT, FINE])
    assert {variant.series for variant in tried} == {*SERIES, DEFAULT}
    labels = [variant.recipe.label for variant in tried]
    assert len(set(labels)) == len(labels)
    by_label = {variant.recipe.label: variant for variant in tried}
    assert (by_label["draft"].fitted_size, by_label["fine"].fitted_size) == (320, 480)
    assert by_label["fine"].recipe.iterations == 7000


@pytest.mark.parametrize("choose", [variants, few_variants], ids=["all", "few"])
def test_nothing_is_fitted_to_more_than_it_is_judged_by(choose):
    assert all(variant.fitted_size <= 240 for variant in choose(240, 600, [DRAFT, FINE]))


def test_the_fronts_hold_what_nothing_beats_in_less_time():
    dear, cheap, beaten = point("dear", 20.0, 30.0), point("cheap", 5.0, 27.0), point("beaten", 10.0, 26.0)
    marked = with_fronts([dear, beaten, cheap])
    assert [(p.label, p.leads_psnr) for p in marked] == [("cheap", True), ("beaten", False), ("dear", True)]


@given(st.floats(0.0, 1.0), st.floats(0.0, 3.0))
def test_consistent_contrast_stays_between_nothing_and_the_contrast(ccpr: float, rwe: float):
    assert 0.0 <= consistent_contrast(ccpr, rwe) <= ccpr


def test_a_scene_that_contradicts_itself_more_than_photographs_scores_nothing_whatever_its_contrast():
    assert consistent_contrast(0.9, 1.2) == consistent_contrast(0.5, 1.2) == 0.0
    assert math.isnan(consistent_contrast(0.9, math.nan))


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    peer = PeerFigures("OpenSplat, full resolution", 500, 9000, 3, 28.0, 200.0, 390.0)
    failed = replace(point("broken", math.nan, math.nan), error="InputError: too few views")
    points = [
        point("200 steps", 5.0, 27.0),
        point("400 steps", 10.0, 29.0),
        point("draft", 12.0, 28.0, DEFAULT),
        point("fine", 90.0, 31.0, DEFAULT),
        ParetoPoint.of_peer("room", 480, peer),
        failed,
    ]
    text = write_pareto(folder, with_fronts(points), ["By `the command`."], base="a base", size=480)
    return folder, text


def test_the_page_says_which_defaults_are_beaten_and_by_what(page):
    _, text = page
    assert "By `the command`." in text
    draft = next(line for line in text.splitlines() if line.startswith("- **draft**"))
    assert "Dominated in PSNR by *400 steps* (10 s, 1.00 dB more)" in draft
    fine = next(line for line in text.splitlines() if line.startswith("- **fine**"))
    assert "On the PSNR front." in fine


def test_the_page_names_the_programs_that_ran_beside_and_the_failures(page):
    _, text = page
    assert "Measured in the same call: OpenSplat." in text
    assert "broken: InputError: too few views" in text


def test_table_and_chart_stand_beside_the_page(page):
    folder, _ = page
    with open(folder / "pareto.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["series"] for row in rows} == {"steps", DEFAULT, PEER}
    assert {row["label"] for row in rows if row["leads_psnr"] == "True"} == {"200 steps", "400 steps", "fine"}
    for name in ("pareto.svg", "pareto-dark.svg", "pareto.png", "pareto-dark.png"):
        assert (folder / name).stat().st_size > 1000
    chart = (folder / "pareto.svg").read_text(encoding="utf-8")
    assert all(word in chart for word in ("draft", "fine", "Pareto front", "other programs"))
