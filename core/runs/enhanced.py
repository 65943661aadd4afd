"""The files that scripts/enhance.py leaves in a folder, known by the table of what it made. Standard library only."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from ..errors import InputError
from ..files.untrusted import read_bytes

METRICS_NAME, SHEET_NAME = "metrics.csv", "sheet.html"
FILE_COLUMN, OUTPUT_COLUMN = "file", "output"
"""First two columns of metrics.csv: the photograph, and what was made of it."""

_MOST_METRICS_BYTES = 32 << 20  # a hundred thousand photographs


def enhanced_files(out: Path) -> list[Path]:
    """What scripts/enhance.py has left in `out`: the pictures that its metrics.csv names, and its own files.

    Pictures that it does not name are the user's own, whatever they are called.
    """
    metrics = out / METRICS_NAME
    try:
        text = read_bytes(metrics, most_bytes=_MOST_METRICS_BYTES).decode("utf-8", "replace")
        rows = csv.DictReader(io.StringIO(text, newline=""))
        if list(rows.fieldnames or ())[:2] != [FILE_COLUMN, OUTPUT_COLUMN]:
            return []
        names = {str(row[OUTPUT_COLUMN] or "") for row in rows}
    except (InputError, csv.Error):
        return []
    plain = [name for name in sorted(names) if name.endswith(".png") and Path(name).name == name and "\0" not in name]
    return [*(out / name for name in plain), out / SHEET_NAME, metrics]
