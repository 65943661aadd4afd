"""Publishes weights: copies them to where the package ships them, with a model card that says what they are."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

from ...core.enhance.gan.weights import SHIPPED, load_generator, read_notes, write_checksum

_PURPOSE = """\
Looks at the photographs of a scene and predicts a scene network, which recolours them so that people with a colour
vision deficiency can tell apart what others can. `scripts/run.py` and `scripts/enhance.py` use it with
`--enhancer cgan`. Observers: protan, deutan, tritan and achromat, severity 0 to 1, under the simulations of Machado,
Viénot and Brettel. At severity 0 nothing changes, greys stay, and colours change by the budget that is asked for.

It is no diagnosis and no aid in traffic, medicine or wherever a colour's meaning is fixed. Trained on drawn pictures
alone, without a single photograph and without the demo capture."""


def publish(weights: Path, folder: Path = SHIPPED.parent) -> Path:
    """Copy a training's weights into `folder`, with their checksum and a model card; returns the card's path.

    Raises:
        InputError: the weights cannot be used.
    """
    load_generator(weights)  # refuses what could not be used
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(weights, folder / SHIPPED.name)
    write_checksum(folder / SHIPPED.name)
    card = folder / "MODEL_CARD.md"
    card.write_text(_card(weights), encoding="utf-8")
    return card


def _card(weights: Path) -> str:
    notes = read_notes(weights)
    parameters = sum(value.numel() for value in load_generator(weights).parameters())
    settings: dict[str, Any] = json.loads(notes["settings"])
    sections = [
        "# Model card: the shipped enhancer",
        _PURPOSE,
        f"| file | `{SHIPPED.name}`, {weights.stat().st_size / 1e6:.1f} MB, {parameters:,} parameters |\n|---|---|\n"
        f"| SHA-256 | `{hashlib.sha256(weights.read_bytes()).hexdigest()}` |\n"
        f"| trained | {notes['date']}, seed {settings['seed']}, step {notes['step']} of {settings['steps']} |\n"
        "| licence | GPL-3.0-or-later, as the code |",
        "Made by `make weights`; recipe, curve and figures are in `docs/enhancer`.",
        "## Settings",
        "\n".join(f"- {name}: {json.dumps(value)}" for name, value in settings.items()),
    ]
    return "\n\n".join(sections) + "\n"
