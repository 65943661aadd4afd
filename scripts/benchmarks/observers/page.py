"""The page of a study: one HTML file that asks no network for anything."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ....core.color.arrangement import AXES, CAPS_UV, LARGEST_NORMAL_CONFUSION, LEAST_SELECTIVITY, cap_colors
from ....core.files.images import to_bytes
from ....core.files.pages import write_page
from ....core.files.untrusted import replacing
from .study import FORMAT, QUESTIONS, REPEATED, Key, Stimulus

PAGE_FILE = "observers.html"
_TEMPLATE = Path(__file__).with_name("page.html")
_SECONDS_A_PAIR, _SECONDS_OF_CAPS = 5, 120  # as guessed for the line about the time


def write_study_page(folder: Path, key: Key, stimuli: Sequence[tuple[Stimulus, list[str]]]) -> Path:
    """Write ``observers.html``, which knows codes but no methods; returns its path.

    Args:
        stimuli: with the codes of their versions.
    """
    # "</script>" in a string would end the element that it is in.
    study = json.dumps(_described(key, stimuli)).replace("<", "\\u003c")
    path = folder / PAGE_FILE
    with replacing(path) as temporary:
        write_page(temporary, _TEMPLATE, study=study)
    return path


def _described(key: Key, stimuli: Sequence[tuple[Stimulus, list[str]]]) -> dict[str, Any]:
    """What the page's script is told."""
    axes = [{"cvd": axis.cvd, "low": axis.low, "high": axis.high} for axis in AXES]
    arrangement = {"uv": CAPS_UV.tolist(), "confusion": LARGEST_NORMAL_CONFUSION, "selectivity": LEAST_SELECTIVITY}
    pairs = key.most_answers / 2 * (1.0 + REPEATED)
    return {
        "format": FORMAT,
        "study": key.study,
        "types": list(dict.fromkeys(stimulus.cvd for stimulus, _ in stimuli)),
        "caps": ["#" + bytes(color).hex() for color in to_bytes(cap_colors())],
        "arrangement": {**arrangement, "axes": axes},
        "questions": [{"id": name, "text": text} for name, text in QUESTIONS.items()],
        "repeated": REPEATED,
        "minutes": max(round((pairs * _SECONDS_A_PAIR + _SECONDS_OF_CAPS) / 60), 1),
        "stimuli": [
            {
                "cvd": stimulus.cvd,
                "versions": [
                    {"code": code, "frames": version.frames}
                    for code, version in sorted(zip(codes, stimulus.versions, strict=True), key=lambda pair: pair[0])
                ],
            }
            for stimulus, codes in stimuli
        ],
    }
