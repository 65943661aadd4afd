"""The picture of a stress test shows what its table says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.errors import InputError
from cvdgs.scripts.benchmark import main
from cvdgs.scripts.benchmarks.stress.heat_map import NAME, read_standings, with_margins, write_heat_map

EVIDENCE = ROOT / "docs" / "evidence"
TABLES = [path for name in ("", "-cloth", "-real") if (path := EVIDENCE / f"stress{name}.csv").exists()]


def item(level: int, *, axis: str = "views", **figures) -> dict:
    usual = {"psnr": 30.0, "rwe": 0.8, "ccpr": 0.8, "ccpr_input": 0.6, "failed": "", "warnings": "", "value": ""}
    return {"method": "layers", "axis": axis if level else "untouched", "level": level, **usual, **figures}


@pytest.mark.parametrize(
    ("figures", "margin"),
    [
        ({}, 1.0),
        ({"psnr": 28.5}, 0.5),
        ({"rwe": 0.9}, 0.5),
        ({"ccpr": 0.65}, 0.25),
        ({"psnr": 28.5, "ccpr": 0.65}, 0.25),
        ({"psnr": 24.0}, -1.0),
        ({"psnr": 33.0, "rwe": 0.1}, 1.0),
    ],
)
def test_a_margin_is_the_share_that_is_left_to_the_nearest_line(figures, margin) -> None:
    found = with_margins(pd.DataFrame([item(0), item(1, **figures)]))
    assert found.margin[found.level == 1].item() == pytest.approx(margin)


def test_where_the_untouched_capture_fails_nothing_is_far_from_failing() -> None:
    found = with_margins(pd.DataFrame([item(0, ccpr=0.5), item(1, ccpr=0.61), item(2, ccpr=0.4)]))
    np.testing.assert_allclose(found.margin, [-0.1, 0.0, -0.2], atol=1e-9)


def test_warnings_of_the_untouched_capture_are_no_news() -> None:
    found = with_margins(pd.DataFrame([item(0, warnings="few-views"), item(1, warnings="few-views no-points")]))
    assert list(found.news) == ["", "no-points"]


def test_every_failure_and_warning_of_the_table_is_in_the_picture(tmp_path: Path) -> None:
    write_heat_map(tmp_path, read_standings(TABLES))
    items = pd.concat([pd.read_csv(path) for path in TABLES]).fillna("")
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", (tmp_path / f"{NAME}.svg").read_text(encoding="utf-8"))
    # The untouched level that axes share stands; that of cloth is an own row of the table.
    assert sum("×" in text for text in texts) == (items.failed != "").sum() + 1  # and the legend
    named = {name for warnings in items.warnings for name in warnings.split()}
    assert named <= {word for text in texts for word in re.findall(r"[a-z]+(?:-[a-z]+)*", text)}


def test_the_picture_on_the_page_is_that_of_its_tables(tmp_path: Path) -> None:
    paths = write_heat_map(tmp_path, read_standings(TABLES))
    assert {path.name for path in paths} == {f"{NAME}.svg", f"{NAME}-dark.svg"}
    for path in paths:
        shown = (EVIDENCE / path.name).read_text(encoding="utf-8")
        texts = [re.findall(r"<text[^>]*>([^<]*)</text>", text) for text in (shown, path.read_text(encoding="utf-8"))]
        assert texts[0] == texts[1]


@pytest.mark.parametrize("content", ["", "a,b\n1,2\n", "\x00\x01"])
def test_another_table_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "stress.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError):
        read_standings([path])


def test_the_picture_is_drawn_again_without_measuring(tmp_path: Path) -> None:
    assert main(["stress", "--out", str(tmp_path), "--redraw", *map(str, TABLES)]) == 0
    assert (tmp_path / f"{NAME}.svg").is_file()
