"""Tables hold what frames hold: numbers in their formats, means of what was measured, and deviations of repetitions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.scripts.benchmarks.tables import (
    frame_of,
    markdown_table,
    means_and_deviations,
    number,
    tables_of_means,
    write_csv,
    write_text,
)

COLUMNS = (("value", "value", ".3f"),)


@dataclass(frozen=True)
class Row:
    name: str
    value: float
    count: int = 0


def table_of(values: list[float]) -> pd.DataFrame:
    return pd.DataFrame({"name": "x", "value": values})


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=6))
def test_means_leave_out_what_could_not_be_measured(values):
    expected = means_and_deviations(table_of(values), ["name"], COLUMNS)
    found = means_and_deviations(table_of([*values, math.nan, math.inf]), ["name"], COLUMNS)
    for one, other in zip(found, expected, strict=True):
        pd.testing.assert_frame_equal(one, other)


def test_there_is_no_deviation_without_repetition():
    keys = [("name", "name", "")]
    alone = tables_of_means(*means_and_deviations(table_of([0.25]), ["name"], COLUMNS), keys, COLUMNS)
    assert alone == ["| name | value |", "| :-- | --: |", "| x | 0.250 |"]
    several = tables_of_means(*means_and_deviations(table_of([0.1, 0.3]), ["name"], COLUMNS), keys, COLUMNS)
    assert [line for line in several if line.startswith("| x")] == ["| x | 0.200 |", "| x | 0.141 |"]
    missing = tables_of_means(*means_and_deviations(table_of([math.nan]), ["name"], COLUMNS), keys, COLUMNS)
    assert missing[-1] == "| x | – |"


@pytest.mark.parametrize(
    ("value", "specification", "shown"),
    [(math.nan, ".2f", "–"), (math.inf, ".2f", "∞"), (0.125, "+.2f", "+0.12"), (1234, "d", "1234"), ("any", "", "any")],
)
def test_numbers_are_shown_in_their_format(value, specification, shown):
    assert number(value, specification) == shown


def test_a_table_without_rows_has_its_header(tmp_path):
    empty = frame_of(Row, [])
    assert markdown_table(empty, COLUMNS) == ["| value |", "| --: |"]
    write_csv(tmp_path / "empty.csv", empty)
    assert (tmp_path / "empty.csv").read_text() == "name,value,count\n"


def test_csv_has_six_digits_and_names_what_is_not_finite(tmp_path):
    write_csv(
        tmp_path / "new" / "rows.csv", frame_of(Row, [Row("a", 1 / 3, 7), Row("b", math.nan), Row("c", math.inf)])
    )
    assert (tmp_path / "new" / "rows.csv").read_text().splitlines()[1:] == ["a,0.333333,7", "b,nan,0", "c,inf,0"]


def test_a_text_ends_with_one_line_break(tmp_path):
    assert write_text(tmp_path / "page.md", ["# Title", "", "text", ""]) == "# Title\n\ntext\n"
