"""The sweep behind the training's settings: short trainings that differ from a base in one thing, and their table."""

from __future__ import annotations

import csv
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core.runtime.protocol import Reporter, StageSpan
from .gan.batches import Examples
from .gan.training import Training, TrainingSettings, validate

BASE = "base"

CHANGES: Mapping[str, dict[str, Any]] = {
    BASE: {},
    "no contrast loss": {"contrast_weight": 0.0},
    "no structure loss": {"structure_weight": 0.0},
    "both weights 60": {"contrast_weight": 60.0, "structure_weight": 60.0},
    "neighbours alone": {"contrast_offsets": (1,)},
    "two-sided contrast": {"one_sided": False},
    "no protection of skin": {"protection": 0.0, "held_weight": 0.0},
    "no discriminator": {"adversarial_weight": 0.0},
    "learning rate 2e-4": {"learning_rate": 2e-4},
    "instance norm": {"generator.normalisation": "instance"},
    "no palette": {"generator.palette": False},
}
"""Name to what differs from the base; ``generator.`` leads to the network's shape."""

COLUMNS = (
    "distance",
    "ccpr_input",
    "ccpr_teacher",
    "ccpr",
    "ssim_input",
    "ssim_teacher",
    "ssim",
    "shift_teacher",
    "shift",
    "minutes",
)
"""Of the table: what `validate` measures, and the time that the training took."""


def changed(base: TrainingSettings, changes: Mapping[str, Any]) -> TrainingSettings:
    """The base with some fields replaced; TypeError for a field that does not exist."""
    shape = {key.removeprefix("generator."): value for key, value in changes.items() if key.startswith("generator.")}
    rest = {key: value for key, value in changes.items() if not key.startswith("generator.")}
    return replace(base, **rest, generator=replace(base.generator, **shape))


def sweep(
    folder: Path,
    examples: Examples,
    validation: Examples,
    base: TrainingSettings,
    names: list[str],
    device: str,
    reporter: Reporter,
) -> None:
    """Train each variant and write ``sweep.csv`` and ``sweep.md`` into the folder; a finished variant is not repeated.

    Args:
        names: of `CHANGES`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for done, name in enumerate(names):
        if name in _read(folder / "sweep.csv"):
            continue
        settings = changed(base, CHANGES[name])
        training = Training(folder / name.replace(" ", "-"), examples, validation, settings, device)
        started = time.monotonic()
        training.run(StageSpan(reporter, "sweep", done / len(names), (done + 1) / len(names), name))
        figures = validate(training.average, validation, device)
        row = {**figures, "minutes": (time.monotonic() - started) / 60.0}
        # Read again: other processes may work on other variants.
        _write(folder, base, {**_read(folder / "sweep.csv"), name: row})


def _read(path: Path) -> dict[str, dict[str, float]]:
    if not path.is_file():
        return {}
    with open(path, newline="", encoding="utf-8") as file:
        return {row["name"]: {column: float(row[column]) for column in COLUMNS} for row in csv.DictReader(file)}


def _write(folder: Path, base: TrainingSettings, rows: dict[str, dict[str, float]]) -> None:
    with open(folder / "sweep.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["name", *COLUMNS])
        writer.writerows([name, *(f"{row[column]:.5f}" for column in COLUMNS)] for name, row in rows.items())
    lines = [
        f"Trainings of {base.steps} steps of {base.batch} crops of {base.crop} pixels, each differing from the base in",
        "one thing. Base: " + ", ".join(f"{key} {value}" for key, value in base.to_dict().items()) + ".",
        "",
        "| variant | " + " | ".join(COLUMNS) + " |",
        "|---|" + "---|" * len(COLUMNS),
        *(f"| {name} | " + " | ".join(f"{row[c]:.4f}" for c in COLUMNS) + " |" for name, row in rows.items()),
    ]
    (folder / "sweep.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
