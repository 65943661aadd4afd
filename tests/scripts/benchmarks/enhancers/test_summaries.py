"""The pages that sum up: means of the right rows, and who is below the LUT in how many pictures."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from cvdgs.core.settings import Layer
from cvdgs.scripts.benchmarks.enhancers.image_sets import ImageSet, TestImage
from cvdgs.scripts.benchmarks.enhancers.scores import Enhanced, Judge
from cvdgs.scripts.benchmarks.enhancers.summaries import compared_with_lut, write_summaries


@pytest.fixture(scope="module")
def image_sets():
    generator = np.random.default_rng(0)
    images = [TestImage(f"{n}.png", generator.integers(90, 170, (32, 32, 3), np.uint8)) for n in range(3)]
    return [ImageSet("garden", tuple(images[:2]), photographs=True), ImageSet("cloth", tuple(images[2:]))]


@pytest.fixture(scope="module")
def scores(image_sets):
    """Every image as it is ("none"), and a little lighter ("lut")."""
    rows = []
    for severity in (0.5, 1.0):
        for image_set in image_sets:
            for image in image_set.images:
                judge = Judge(image_set.name, image, Layer("deutan", severity))
                versions = {"none": image.pixels, "lut": image.pixels + np.uint8(9)}
                rows += [judge.score(Enhanced(method, pixels, 0.0, 0.0)) for method, pixels in versions.items()]
    return pd.DataFrame(rows)


def table_after(text, heading):
    """The cells of the first table behind a heading, by the words of its first columns."""
    lines = text[text.index(heading) :].splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith("|"))
    rows = []
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return [dict(zip(rows[0], row, strict=True)) for row in rows[2:]]


def test_other_measures_are_of_each_group_at_the_strongest_severity(scores, image_sets, tmp_path):
    write_summaries(tmp_path, scores, image_sets, "Three pictures.")
    text = (tmp_path / "judges.md").read_text(encoding="utf-8")
    assert "Three pictures." in text
    rows = table_after(text, "## photographs, severity 1")
    assert [(row["type"], row["method"], row["n"]) for row in rows] == [("deutan", "none", "2"), ("deutan", "lut", "2")]
    mine = scores[(scores.image_set == "garden") & (scores.severity == 1.0) & (scores.method == "lut")]
    assert float(rows[1]["names lost"]) == pytest.approx(mine.name_confusions.mean(), abs=5e-4)
    assert float(rows[1]["CAM change"]) == pytest.approx(mine.cam_change.mean(), abs=5e-3)
    assert float(rows[0]["CAM change"]) == 0.0
    assert table_after(text, "## cloth, severity 1")[0]["n"] == "1"


def test_the_worst_model_is_a_column_only_where_there_are_several(scores, image_sets, tmp_path):
    write_summaries(tmp_path, scores, image_sets, "Three pictures.")
    assert "that describe the type" in (tmp_path / "judges.md").read_text(encoding="utf-8")
    alone = scores.assign(ccpr_vienot=math.nan, ccpr_brettel=math.nan)  # as with --quick
    write_summaries(tmp_path, alone, image_sets, "Three pictures.")
    assert "orst model" not in (tmp_path / "judges.md").read_text(encoding="utf-8")


def test_every_severity_has_its_lines_and_the_lut_is_compared_with_others(scores, image_sets, tmp_path):
    write_summaries(tmp_path, scores, image_sets, "Three pictures.")
    text = (tmp_path / "severities.md").read_text(encoding="utf-8")
    rows = table_after(text, "## all photographs")
    assert [(row["severity"], row["method"]) for row in rows] == [
        ("0.5", "none"),
        ("0.5", "lut"),
        ("1", "none"),
        ("1", "lut"),
    ]
    assert {row["n"] for row in rows} == {"2"}  # the cloth is no photograph
    compared = table_after(text, "## Picture by picture against the LUT")
    assert [row["method"] for row in compared] == ["none", "none"]
    assert {row["ΔE00"] for row in compared} == {"1.00"}  # nothing changes less than none


def test_without_photographs_there_is_no_page_of_severities(scores, image_sets, tmp_path):
    write_summaries(tmp_path, scores[scores.image_set == "cloth"], image_sets[1:], "One picture.")
    assert not (tmp_path / "severities.md").exists()
    assert "## cloth" in (tmp_path / "judges.md").read_text(encoding="utf-8")


def test_a_method_is_below_the_lut_by_more_than_a_thousandth_or_not_at_all():
    rows = pd.DataFrame(
        {
            "ccpr": [0.8, 0.8, 0.8, math.nan],
            "ccpr_lut": [0.7, 0.8005, 0.9, 0.5],
            "ccpr_global": [0.9] * 4,
            "ccpr_global_lut": [0.9] * 4,
            "ccfr": [0.9] * 4,
            "ccfr_lut": [0.95] * 4,
            "ssim_simulated": [math.nan] * 4,
            "ssim_simulated_lut": [0.9] * 4,
            "delta_e_2000": [1.0, 2.0, 3.0, 4.0],
            "delta_e_2000_lut": [2.0] * 4,
        }
    )
    found = compared_with_lut(rows)
    assert found["ccpr"] == pytest.approx(2 / 3)
    assert (found["ccpr_global"], found["ccfr"], found["delta_e_2000"]) == (1.0, 0.0, 0.5)
    assert math.isnan(found["ssim_simulated"])
