"""The comparison of enhancers: its controls are honest, its figures are those of other implementations."""

from __future__ import annotations

import csv
import math
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import torch
from colorspacious import cspace_convert

from cvdgs.core.capture.images import read_header
from cvdgs.core.enhance import ColorLut
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import to_bytes, write_png
from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.enhancers.comparison import STRENGTHS, TRADE_OFFS, EnhancerBenchmark, compare_enhancers
from cvdgs.scripts.benchmarks.enhancers.image_sets import (
    ImageSet,
    TestImage,
    fresh_plates,
    fresh_textiles,
    read_photographs,
)
from cvdgs.scripts.benchmarks.enhancers.methods import (
    blend,
    check_labels,
    gain_references,
    matched_gain,
    method_factory,
    method_label,
)
from cvdgs.scripts.benchmarks.enhancers.report import (
    image_class,
    kept_gain,
    mean,
    protected_mean,
    readable_plates,
    select,
    targets_of,
    with_classes,
)
from cvdgs.scripts.benchmarks.enhancers.scores import Enhanced, Judge

DEUTAN = Layer("deutan", 1.0)


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
    plan = EnhancerBenchmark(("none", "gain", "fidaner"), types=("deutan", "protan"), severities=(1.0,))
    return compare_enhancers(image_sets, plan)


@pytest.fixture(scope="module")
def scores(comparison):
    return pd.DataFrame(comparison.scores)


def test_every_method_meets_every_image_and_a_plate_its_own_type_only(scores):
    cells = {(row.image, row.cvd, row.method) for row in scores.itertuples()}
    methods = ("none", "fidaner", "gain as fidaner")
    expected = {
        (name, cvd, method) for name in ("0.png", "1.png") for cvd in ("deutan", "protan") for method in methods
    }
    expected |= {(f"{cvd}-00", cvd, method) for cvd in ("deutan", "protan") for method in methods}
    assert cells == expected
    assert len(scores) == len(expected)


def test_no_enhancement_scores_as_the_input_and_changes_nothing(scores):
    for row in select(scores, method="none").itertuples():
        assert row.ccpr == row.ccpr_input
        assert (row.psnr, row.delta_e_76) == (math.inf, pytest.approx(0, abs=1e-6))
        assert row.delta_e_2000 == pytest.approx(0, abs=1e-9)
        assert row.plate_after == row.plate_before or math.isnan(row.plate_before)


def test_matched_gain_changes_an_image_as_much_as_its_reference(scores):
    references = select(scores, method="fidaner").set_index(["image", "cvd"]).delta_e_76
    for row in select(scores, method="gain as fidaner", image_set="photographs").itertuples():
        assert row.delta_e_76 == pytest.approx(references[row.image, row.cvd], rel=0.03)


@pytest.mark.parametrize("asked", [2.0, 12.0])
def test_matched_gain_has_the_change_that_is_asked_for(asked):
    image = patches()
    gained = matched_gain("lut", image, asked)
    labs = [cspace_convert(pixels.reshape(-1, 3), "sRGB255", "CIELab") for pixels in (image, gained.pixels)]
    assert np.linalg.norm(labs[0] - labs[1], axis=1).mean() == pytest.approx(asked, rel=0.05)  # bytes are coarse


def test_what_is_kept_under_another_model_is_the_ratio_of_mean_gains(scores):
    rows = select(scores, method="none", image_set="photographs", cvd="deutan")
    before = rows.assign(ccpr=0.5, ccpr_brettel=0.6)
    after = rows.assign(method="x", ccpr=[0.6, 0.8], ccpr_brettel=[0.7, 0.7])
    every_row = pd.concat([before, after])
    assert kept_gain(after, every_row, "brettel") == pytest.approx(0.5)
    assert kept_gain(after, every_row, "machado") == pytest.approx(1.0)
    assert math.isnan(kept_gain(before, before, "brettel"))


def test_a_plates_difference_is_that_of_its_mean_colours():
    figure = np.zeros((16, 16), bool)
    figure[:8] = True
    pixels = np.where(figure[..., None], 100, 200).repeat(3, -1).astype(np.uint8)  # greys, which S keeps
    judge = Judge("plates", TestImage("p", pixels, "deutan", figure, ~figure), DEUTAN)
    row = judge.score(Enhanced("none", pixels, 0.0, 0.0))
    levels = cspace_convert(np.array([[100, 100, 100], [200, 200, 200]]), "sRGB255", "CIELab")
    assert row["plate_before"] == pytest.approx(np.linalg.norm(levels[0] - levels[1]), abs=0.01)
    assert readable_plates(pd.DataFrame([row, row | {"plate_after": 9.9}])) == 0.5


def test_other_models_judge_what_they_describe():
    image = TestImage("x", patches())
    unchanged = Enhanced("none", image.pixels, 0.0, 0.0)
    tritan = Judge("s", image, Layer("tritan", 1.0)).score(unchanged)
    assert math.isnan(tritan["ccpr_vienot"])
    assert 0.0 < tritan["ccpr_brettel"] < 1.0
    alone = Judge("s", image, DEUTAN, other_models=False).score(unchanged)
    assert math.isnan(alone["ccpr_vienot"])
    assert math.isnan(alone["ccpr_brettel"])


def test_protected_colours_are_averaged_over_pixels():
    rows = pd.DataFrame({"grey_pixels": [300, 100, 0], "grey_delta_e": [1.0, 3.0, math.nan]})
    assert protected_mean(rows, "grey") == pytest.approx(1.5)
    assert math.isnan(protected_mean(rows[2:], "grey"))


def test_means_leave_out_missing_values():
    assert mean(pd.DataFrame({"psnr": [30.0, math.inf, math.nan]}), "psnr") == 30.0
    assert mean(pd.DataFrame({"psnr": [math.inf]}), "psnr") == math.inf
    assert math.isnan(mean(pd.DataFrame({"psnr": []}), "psnr"))


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


def test_trade_offs_are_of_hard_images_at_every_strength(comparison, scores):
    points = pd.DataFrame(comparison.trade_offs, columns=TRADE_OFFS)
    keys = ["image", "cvd"]
    hard = scores[scores.ccpr_input < 0.9]
    assert set(points[keys].itertuples(index=False, name=None)) == set(hard[keys].itertuples(index=False, name=None))
    assert set(select(points, method="fidaner", cvd="deutan").strength) == set(STRENGTHS)
    full = hard.merge(select(points, strength=1.0), on=[*keys, "method"], suffixes=("", "_point"))
    assert len(full) == len(hard)
    assert (full.ccpr == full.ccpr_point).all()


def test_gain_is_matched_to_every_network_else_to_the_lut():
    assert gain_references(["none", "lut", "gain", "cgan", "a/b.safetensors"]) == ["cgan", "a/b.safetensors"]
    assert gain_references(["lut", "scene"]) == ["scene"]
    assert gain_references(["lut", "cgan", "scene"]) == ["cgan", "scene"]
    assert gain_references(["fidaner", "lut"]) == ["lut"]
    with pytest.raises(InputError, match="needs a method to match"):
        gain_references(["none", "gain"])
    assert method_label("a/b.safetensors") == "b"
    assert (method_label("cgan@0"), method_label("a/b.safetensors@3")) == ("cgan@0", "b@3")


def test_a_prediction_can_be_named_without_and_with_its_fit():
    image = np.random.default_rng(0).integers(0, 256, (24, 24, 3), np.uint8)
    results = []
    for name in ("cgan@0", "cgan@2"):
        enhancer = method_factory(name)("deutan", 1.0, "machado")
        enhancer.fit([image])
        results.append(enhancer(image))
    assert not np.array_equal(*results)


def test_the_headline_compares_with_the_controls_on_the_same_images(scores):
    row = select(scores, method="none", image_set="photographs", cvd="deutan").iloc[:1]
    methods = (("none", 0.7), ("lut", 0.8), ("gain as cgan", 0.9), ("cgan", 0.85))
    rows = pd.concat([row.assign(method=method, ccpr_input=0.7, ccpr=ccpr) for method, ccpr in methods])

    quick, slow = (targets_of(with_classes(rows), "cgan", ["photographs"], seconds) for seconds in (0.5, 0.91))
    assert quick.reached[quick.what.str.startswith("CCPR, hard")].tolist() == ["yes", "yes", "**no**"]
    assert (quick.reached.iloc[-1], slow.reached.iloc[-1]) == ("yes", "**no**")


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
    assert {"ccpr", "ccpr_vienot", "delta_e_76", "grey_pixels", "skin_delta_e", "plate_after"} < set(rows[0])
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
