"""The comparison of enhancers: its controls are honest, its figures are those of other implementations."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import torch
from colorspacious import cspace_convert

from cvdgs.core.capture.images import read_header
from cvdgs.core.enhance import ColorLut
from cvdgs.core.errors import InputError
from cvdgs.core.evaluate.enhancers.benchmark import EnhancerBenchmark
from cvdgs.core.evaluate.enhancers.figures import figures_to_reach
from cvdgs.core.evaluate.enhancers.image_sets import ImageSet, TestImage, fresh_plates, fresh_textiles, read_photographs
from cvdgs.core.evaluate.enhancers.means import held_mean, image_class, kept_gain, mean, readable_plates, select
from cvdgs.core.evaluate.enhancers.methods import (
    blend,
    check_labels,
    gain_references,
    matched_gain,
    method_label,
)
from cvdgs.core.evaluate.enhancers.scores import Enhanced, EnhancerScores, Judge
from cvdgs.core.evaluate.enhancers.table import STRENGTHS, ComparisonPlan, compare_enhancers
from cvdgs.core.images import to_bytes, write_png
from cvdgs.core.settings import Layer

DEUTAN, PROTAN = Layer("deutan", 1.0), Layer("protan", 1.0)


def patches(seed=0, size=48):
    """An image of random patches whose contrasts, of red and green for the most part, are lost in the simulation."""
    generator = np.random.default_rng(seed)
    kinds = generator.integers(0, 2, (size // 8, size // 8))
    colors = np.array([(181, 109, 109), (109, 139, 109)])[kinds] + generator.integers(-9, 10, (*kinds.shape, 3))
    return colors.repeat(8, 0).repeat(8, 1).astype(np.uint8)


@pytest.fixture(scope="module")
def image_sets():
    photographs = tuple(TestImage(f"{seed}.png", patches(seed)) for seed in range(2))
    return [ImageSet("photographs", photographs, photographs=True), fresh_plates(1, 96, ("protan", "deutan"))]


@pytest.fixture(scope="module")
def comparison(image_sets):
    plan = ComparisonPlan(("none", "gain", "fidaner"), (DEUTAN, PROTAN))
    return compare_enhancers(image_sets, plan)


def test_every_method_meets_every_image_and_a_plate_its_own_type_only(comparison):
    cells = {(row.image, row.cvd, row.method) for row in comparison.scores}
    methods = ("none", "fidaner", "gain as fidaner")
    expected = {
        (name, cvd, method) for name in ("0.png", "1.png") for cvd in ("deutan", "protan") for method in methods
    }
    expected |= {(f"{cvd}-00", cvd, method) for cvd in ("deutan", "protan") for method in methods}
    assert cells == expected
    assert len(comparison.scores) == len(expected)


def test_no_enhancement_scores_as_the_input_and_changes_nothing(comparison):
    for row in select(comparison.scores, method="none"):
        assert row.ccpr == row.ccpr_input
        assert (row.psnr, row.delta_e_76, row.delta_e_2000) == (math.inf, pytest.approx(0, abs=1e-6), 0.0)
        assert row.plate_after == row.plate_before or math.isnan(row.plate_before)


def test_matched_gain_changes_an_image_as_much_as_its_reference(comparison):
    references = {(row.image, row.cvd): row for row in select(comparison.scores, method="fidaner")}
    matched = select(comparison.scores, method="gain as fidaner", image_sets=["photographs"])
    for row in matched:
        assert row.delta_e_76 == pytest.approx(references[row.image, row.cvd].delta_e_76, rel=0.03)


@pytest.mark.parametrize("asked", [2.0, 12.0])
def test_matched_gain_has_the_change_that_is_asked_for(asked):
    image = patches()
    gained = matched_gain("lut", image, asked)
    labs = [cspace_convert(pixels.reshape(-1, 3), "sRGB255", "CIELab") for pixels in (image, gained.pixels)]
    assert np.linalg.norm(labs[0] - labs[1], axis=1).mean() == pytest.approx(asked, rel=0.05)  # bytes are coarse


def test_what_is_kept_under_another_model_is_the_ratio_of_mean_gains(comparison):
    rows = select(comparison.scores, method="none", image_sets=["photographs"], cvd="deutan")
    before = [replace(row, ccpr=0.5, ccpr_brettel=0.6) for row in rows]
    gains = [(0.1, 0.1), (0.3, 0.1)]
    after = [
        replace(row, method="x", ccpr=0.5 + gain, ccpr_brettel=0.6 + other)
        for row, (gain, other) in zip(rows, gains, strict=True)
    ]
    assert kept_gain(after, before + after, "brettel") == pytest.approx(0.5)
    assert kept_gain(after, before + after, "machado") == pytest.approx(1.0)
    assert math.isnan(kept_gain(before, before, "brettel"))


def test_a_plates_difference_is_that_of_its_mean_colours():
    figure = np.zeros((16, 16), bool)
    figure[:8] = True
    pixels = np.where(figure[..., None], 100, 200).repeat(3, -1).astype(np.uint8)  # greys, which S keeps
    judge = Judge("plates", TestImage("p", pixels, "deutan", figure, ~figure), DEUTAN)
    row = judge.score(Enhanced("none", pixels, 0.0, 0.0))
    levels = cspace_convert(np.array([[100, 100, 100], [200, 200, 200]]), "sRGB255", "CIELab")
    assert row.plate_before == pytest.approx(np.linalg.norm(levels[0] - levels[1]), abs=0.01)
    assert readable_plates([row, replace(row, plate_after=9.9)]) == 0.5


def test_other_models_judge_what_they_describe():
    image = TestImage("x", patches())
    unchanged = Enhanced("none", image.pixels, 0.0, 0.0)
    tritan = Judge("s", image, Layer("tritan", 1.0)).score(unchanged)
    assert math.isnan(tritan.ccpr_vienot)
    assert 0.0 < tritan.ccpr_brettel < 1.0
    alone = Judge("s", image, DEUTAN, other_models=False).score(unchanged)
    assert math.isnan(alone.ccpr_vienot)
    assert math.isnan(alone.ccpr_brettel)


def test_held_colours_are_averaged_over_pixels(comparison):
    row = comparison.scores[0]
    rows = [
        replace(row, grey_pixels=300, grey_delta_e=1.0),
        replace(row, grey_pixels=100, grey_delta_e=3.0),
        replace(row, grey_pixels=0, grey_delta_e=math.nan),
    ]
    assert held_mean(rows, "grey") == pytest.approx(1.5)
    assert math.isnan(held_mean(rows[2:], "grey"))


def test_means_leave_out_what_is_not_there(comparison):
    row = comparison.scores[0]
    assert mean([replace(row, psnr=30.0), replace(row, psnr=math.inf), replace(row, psnr=math.nan)], "psnr") == 30.0
    assert mean([replace(row, psnr=math.inf)], "psnr") == math.inf
    assert math.isnan(mean([], "psnr"))


@pytest.mark.parametrize(
    ("ccpr", "kind"),
    [(0.899, "hard"), (0.9, "between"), (0.97, "between"), (0.971, "easy"), (math.nan, "undefined")],
)
def test_images_are_hard_below_nine_tenths_and_easy_above_97_hundredths(ccpr, kind):
    assert image_class(ccpr) == kind


def test_part_of_the_strength_is_what_a_lut_makes_of_it():
    image = patches()
    lut = ColorLut(torch.from_numpy(np.random.default_rng(0).uniform(-0.2, 0.2, (3, 3, 3, 3))))
    full = to_bytes(lut(image))
    assert np.abs(blend(image, full, 0.5).astype(int) - to_bytes(lut(image, 0.5))).max() <= 1
    np.testing.assert_array_equal(blend(image, full, 0.0), image)
    np.testing.assert_array_equal(blend(image, full, 1.0), full)


def test_trade_offs_are_of_hard_images_at_every_strength(comparison):
    hard = {(row.image, row.cvd) for row in comparison.scores if row.ccpr_input < 0.9}
    assert {(point.image, point.cvd) for point in comparison.trade_offs} == hard
    strengths = [p.strength for p in comparison.trade_offs if p.method == "fidaner" and p.cvd == "deutan"]
    assert set(strengths) == set(STRENGTHS)
    full = {(p.image, p.cvd, p.method): p.ccpr for p in comparison.trade_offs if p.strength == 1.0}
    for row in comparison.scores:
        if (row.image, row.cvd) in hard:
            assert full[row.image, row.cvd, row.method] == row.ccpr


def test_gain_is_matched_to_every_network_else_to_the_lut():
    assert gain_references(["none", "lut", "gain", "cgan", "a/b.safetensors"]) == ["cgan", "a/b.safetensors"]
    assert gain_references(["fidaner", "lut"]) == ["lut"]
    with pytest.raises(InputError, match="needs a method to match"):
        gain_references(["none", "gain"])
    assert method_label("a/b.safetensors") == "b"


def test_the_headline_compares_with_the_controls_on_the_same_images(comparison):
    row = select(comparison.scores, method="none", image_sets=["photographs"], cvd="deutan")[0]
    rows = [
        replace(row, method=method, ccpr_input=0.7, ccpr=ccpr)
        for method, ccpr in (("none", 0.7), ("lut", 0.8), ("gain as cgan", 0.9), ("cgan", 0.85))
    ]
    verdicts = {f.what: f.reached for f in figures_to_reach(rows, "cgan", ["photographs"], 0.5) if "CCPR τ" in f.what}
    assert list(verdicts.values()) == [True, True, False]
    assert figures_to_reach(rows, "cgan", ["photographs"], 0.5)[-1].reached
    assert figures_to_reach(rows, "cgan", ["photographs"], 0.91)[-1].reached is False


def test_fresh_images_are_the_same_every_time_and_all_different():
    first, again = fresh_plates(2, 96, ("tritan",)), fresh_plates(2, 96, ("tritan",))
    for one, other in zip(first.images, again.images, strict=True):
        np.testing.assert_array_equal(one.pixels, other.pixels)
    assert not np.array_equal(first.images[0].pixels, first.images[1].pixels)
    assert (first.images[0].figure & first.images[0].ground).sum() == 0
    assert len({image.pixels.tobytes() for image in fresh_textiles(7, 48).images}) == 7


def test_photographs_are_reduced_to_the_size(tmp_path):
    for number in range(5):
        write_png(tmp_path / f"{number}.png", patches(number, size=64)[:32])
    found = read_photographs("set", tmp_path, 40, limit=3)
    assert [image.pixels.shape for image in found.images] == [(20, 40, 3)] * 3
    with pytest.raises(InputError, match="no photographs"):
        read_photographs("set", tmp_path / "missing", 40)


def test_a_comparison_is_written_as_rows_tables_a_chart_and_sheets(tmp_path):
    write_png(tmp_path / "photos" / "a.png", patches())
    benchmark = EnhancerBenchmark(
        ("none", "gain", "fidaner"),
        {"garden": tmp_path / "photos"},
        types=("deutan",),
        severities=(1.0, 0.4),
        size=96,
        plates=1,
        textiles=1,
    )
    text = benchmark.run(tmp_path / "out")
    assert "## Figures to reach: fidaner, severity 1" in text
    assert "## garden: deutan 0.4" in text
    with open(tmp_path / "out" / "enhancer.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert set(rows[0]) == set(EnhancerScores.__dataclass_fields__)
    assert len(rows) == 3 * 2 * 3  # images, severities, methods
    assert {row["severity"] for row in rows} == {"1", "0.4"}
    chart = ElementTree.parse(tmp_path / "out" / "enhancer.svg").getroot()
    assert {"deutan", "none", "fidaner"} <= {element.text for element in chart.iterfind(".//{*}text")}
    sheet = read_header(tmp_path / "out" / "sheet-garden-deutan-1.0.png")
    assert sheet.width == 3 * (256 + 4)


def test_a_benchmark_of_nothing_is_refused(tmp_path):
    with pytest.raises(InputError, match="no enhancer"):
        EnhancerBenchmark(()).run(tmp_path)
    with pytest.raises(InputError, match="no images"):
        EnhancerBenchmark(("none",), plates=0, textiles=0).run(tmp_path)
    with pytest.raises(InputError, match="too small"):
        EnhancerBenchmark(("none",), size=64).run(tmp_path)


def test_methods_that_tables_could_not_tell_apart_are_refused():
    with pytest.raises(InputError, match="two methods are called enhancer"):
        check_labels(["none", "first/enhancer.safetensors", "second/enhancer.safetensors"])
