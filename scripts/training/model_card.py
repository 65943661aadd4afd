"""Publishes weights: copies them to where the package ships them, with a model card that says what they are."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...core.enhance.gan.weights import SHIPPED, load_generator, read_notes, write_checksum
from ...core.errors import InputError
from .gan.training import WEIGHTS

_PURPOSE = """\
Recolours photographs, view by view, so that people with a colour vision deficiency can tell apart what others can. It
starts from one look-up table that is fitted to the whole scene. Made for textiles photographed from several sides;
`scripts/run.py` and `scripts/enhance.py` use it with `--enhancer cgan`. Observers: protan, deutan, tritan and achromat,
severity 0 to 1, under the simulations of Machado, Viénot and Brettel. At severity 0 it is the identity by construction,
greys stay, and colours like skin move less.

It is not a diagnosis, and no aid in traffic, medicine or wherever a colour's meaning is fixed. Trained on drawn and
rendered images alone, without a single photograph. The renders are two variants of the demo capture's room in other
colours, so the demo is not entirely unseen."""


def publish(training: Path, evaluations: Sequence[Path], folder: Path = SHIPPED.parent) -> Path:
    """Copy a training's weights into `folder`, with their checksum and a model card; returns the card's path.

    Args:
        training: folder of a finished training.
        evaluations: folders of ``benchmark.py enhancer`` for these weights.

    Raises:
        InputError: one of the folders lacks what is needed.
    """
    weights, reports = training / WEIGHTS, [evaluation / "enhancer.md" for evaluation in evaluations]
    load_generator(weights)  # refuses what could not be used
    for report in reports:
        if not report.is_file():
            raise InputError("there is no comparison", where=report, remedy="run benchmark.py enhancer first")
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(weights, folder / SHIPPED.name)
    write_checksum(folder / SHIPPED.name)
    card = folder / "MODEL_CARD.md"
    texts = [report.read_text(encoding="utf-8") for report in reports]
    card.write_text(_card(weights, texts), encoding="utf-8")
    return card


def _card(weights: Path, reports: Sequence[str]) -> str:
    notes = read_notes(weights)
    generator = load_generator(weights)
    settings, dataset = json.loads(notes["settings"]), json.loads(notes["dataset"])
    parameters = sum(value.numel() for value in generator.parameters())
    sections = [
        "# Model card: the shipped enhancer",
        _PURPOSE,
        f"| file | `{SHIPPED.name}`, {weights.stat().st_size / 1e6:.1f} MB, {parameters:,} parameters |\n|---|---|\n"
        f"| SHA-256 | `{hashlib.sha256(weights.read_bytes()).hexdigest()}` |\n"
        f"| trained | {notes['date']} on {notes['device']}, seed {settings['seed']}, step {notes['step']} of "
        f"{settings['steps']} |\n"
        "| licence | GPL-3.0-or-later, as the code |",
        "## Data",
        _data(dataset),
        "## Settings",
        _phases(notes),
        "## Measured",
        "By `scripts/benchmark.py enhancer`, on images that no training saw.",
        *(_measured(report) for report in reports),
    ]
    return "\n\n".join(sections) + "\n"


def _list(settings: dict[str, Any]) -> str:
    return "\n".join(f"- {name}: {json.dumps(value)}" for name, value in settings.items())


def _phases(notes: dict[str, str]) -> str:
    """The settings of the training and of those that it started from, the earliest first."""
    settings = json.loads(notes["settings"])
    text = f"{notes['step']} steps with\n\n{_list(settings)}"
    if "start" not in notes:
        return text
    return f"{_phases(json.loads(notes['start']))}\n\nand from there {text}"


def _data(dataset: dict[str, Any]) -> str:
    kinds = ", ".join(f"{count} {kind}" for kind, count in dataset["kinds"].items())
    return (
        f"{dataset['samples']} images of {dataset['size']} pixels ({kinds}), {dataset['observers']} observers each, "
        f"seed {dataset['seed']}; made by `scripts/train_enhancer.py` with the {dataset['teacher']} teacher, nothing "
        f"downloaded. `photograph` stands for crops of {len(dataset.get('photographs', []))} given images."
    )


def _measured(report: str) -> str:
    """The description and the headline of a comparison."""
    before, _, rest = report.partition("\n## Figures to reach")
    headline = rest.partition("\n## ")[0].partition("\n")[2]
    rows = [row for row in headline.strip().splitlines() if "| –" not in row]  # without what was not measured
    return before.partition("\n")[2].strip() + "\n\n" + "\n".join(rows)
