"""Tables as files: CSV of dataclasses, and Markdown."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any


def write_csv(path: Path, record: type, rows: Sequence[Any]) -> None:
    """One line a row of the dataclass `record`, under its field names; floating-point numbers to six digits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(record)])
        for row in rows:
            writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in astuple(row)])


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a table; numbers are the caller's to format. Text columns stand left, those of numbers right."""
    body = [list(row) for row in rows]
    left = [any(not _is_number(row[column]) for row in body) for column in range(len(header))]
    rule = [":--" if text else "--:" for text in left]
    return ["| " + " | ".join(cells) + " |" for cells in (header, rule, *body)]


def number(value: float, digits: int) -> str:
    """`value` with so many digits behind the point; a dash for NaN."""
    if math.isnan(value):
        return "–"
    return "∞" if math.isinf(value) else f"{value:.{digits}f}"


def _is_number(cell: str) -> bool:
    """Whether it is a number, or one with its spread."""
    mean, _, _ = cell.partition(" ± ")
    return mean in ("–", "∞") or mean.replace(".", "", 1).lstrip("-+").isdigit()
