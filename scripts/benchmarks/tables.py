"""The tables of benchmarks as files: CSV and Markdown written from pandas frames, one number to a cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

Column = tuple[str, str, str]
"""A column of a frame, its title in Markdown, and its format specification: ".3f", "+.2f", "d"; "" for text."""


def frame_of(record: type, rows: Sequence[Any]) -> pd.DataFrame:
    """A row for each instance of the dataclass `record`, a column for each of its fields."""
    return pd.DataFrame([astuple(row) for row in rows], columns=[field.name for field in fields(record)])


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a frame without its index; floating-point numbers to six digits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(path, index=False, float_format="%.6g", na_rep="nan")


def write_text(path: Path, lines: Sequence[str]) -> str:
    """Write the lines of a text; returns it."""
    text = "\n".join(lines).rstrip() + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return text


def number(value: Any, specification: str) -> str:
    """A number as tables show it: a dash for NaN, a sign for infinity; text stays as it is."""
    if isinstance(value, str) or not specification:
        return str(value)
    if math.isnan(value):
        return "–"
    return "∞" if math.isinf(value) else format(value, specification)


def markdown_table(table: pd.DataFrame, columns: Sequence[Column]) -> list[str]:
    """The lines of a table: text is aligned to the left, numbers to the right."""
    header = [title for _, title, _ in columns]
    rule = ["--:" if specification else ":--" for _, _, specification in columns]
    cells = [[number(value, specification) for value in table[name]] for name, _, specification in columns]
    return ["| " + " | ".join(row) + " |" for row in (header, rule, *zip(*cells, strict=True))]


def means_and_deviations(
    table: pd.DataFrame, by: Sequence[str], columns: Sequence[Column]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Means and sample standard deviations of the finite values of `columns`, over rows that are equal in `by`.

    NaN where there are no values, or fewer than two.
    """
    names = [name for name, _, _ in columns]
    groups = table.replace([np.inf, -np.inf], np.nan).groupby(list(by), sort=False)[names]
    return groups.mean().reset_index(), groups.std().reset_index()


def tables_of_means(
    means: pd.DataFrame, deviations: pd.DataFrame, keys: Sequence[Column], columns: Sequence[Column]
) -> list[str]:
    """The lines of a table of means and, unless nothing was repeated, of one of their standard deviations."""
    lines = markdown_table(means, [*keys, *columns])
    if not deviations[[name for name, _, _ in columns]].notna().any(axis=None):
        return lines
    unsigned = [(name, title, specification.lstrip("+")) for name, title, specification in columns]
    return [*lines, "", "Standard deviations:", "", *markdown_table(deviations, [*keys, *unsigned])]
