"""Studies without pictures worth seeing, and participants whose preferences are known."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cvdgs.scripts.benchmarks.embedding import jpeg_uri
from cvdgs.scripts.benchmarks.observers.study import (
    FORMAT,
    QUESTIONS,
    STILL,
    TURNTABLE,
    Key,
    Stimulus,
    Version,
    with_codes,
)

METHODS = ("original", "lut", "scene", "gain")
IN_ORDER = list(range(1, 16))
# Made by observers of severity 1 (Machado 2009) who take the cap that looks nearest to the last one.
ROWS = {
    "": IN_ORDER,
    "protan": [15, 1, 14, 2, 13, 3, 12, 4, 11, 5, 10, 6, 9, 7, 8],
    "deutan": [1, 15, 2, 14, 3, 4, 13, 5, 12, 11, 6, 10, 7, 9, 8],
    "tritan": [1, 2, 3, 4, 5, 6, 7, 15, 8, 14, 13, 12, 11, 10, 9],
}
TRUTH = {
    "visibility": {"original": 0.0, "lut": 1.1, "scene": 1.6, "gain": 0.5},
    "naturalness": {"original": 0.0, "lut": -1.2, "scene": -0.5, "gain": -0.8},
}


def stimuli(types: tuple[str, ...] = ("protan", "deutan"), *, photographs: int = 4, turns: int = 0) -> list[Stimulus]:
    """Plain grey pictures, each of another grey."""
    greys = itertools.count(60)

    def version(method: str, frames: int) -> Version:
        pictures = [np.full((12, 16, 3), next(greys) % 250, np.uint8) for _ in range(frames)]
        return Version(method, tuple(jpeg_uri(picture, 90) for picture in pictures), 1.0)

    found = []
    for cvd in types:
        for number in range(photographs):
            found.append(Stimulus(cvd, STILL, f"photograph {number}", tuple(version(m, 1) for m in METHODS)))
        if turns:
            found.append(Stimulus(cvd, TURNTABLE, "scene", tuple(version(m, turns) for m in ("original", "ours"))))
    return found


def study(**options: Any) -> Key:
    """The key of a study of such pictures."""
    return with_codes(stimuli(**options), "python scripts/benchmark.py observers --out DIR", 0)[0]


def session(
    key: Key, seed: int, truth: Mapping[str, Mapping[str, float]] = TRUTH, *, cvd: str = "deutan", noise: float = 0.0
) -> dict[str, Any]:
    """What somebody saves who chooses by Bradley and Terry's model.

    Args:
        truth: strengths of the methods by question.
        noise: standard deviation by which the participant's own strengths differ from these.
    """
    rng = np.random.default_rng([seed, 77])
    own = {q: {m: s + noise * rng.standard_normal() for m, s in methods.items()} for q, methods in truth.items()}
    by_stimulus: dict[tuple[str, str, str], list[str]] = {}
    for code, item in key.shown.items():
        if item.cvd == cvd and item.kind == STILL:
            by_stimulus.setdefault(item.stimulus, []).append(code)
    answers = []
    for question in QUESTIONS:
        pairs = [pair for codes in by_stimulus.values() for pair in itertools.combinations(codes, 2)]
        shown = [(pair, False) for pair in pairs] + [(pair[::-1], True) for pair in pairs[:6]]
        for (left, right), repeat in shown:
            odds = own[question][key.shown[left].method] - own[question][key.shown[right].method]
            choice = left if rng.random() < 1.0 / (1.0 + np.exp(-odds)) else right
            answers.append(
                {"question": question, "left": left, "right": right, "choice": choice, "repeat": repeat, "ms": 900}
            )
    row = ROWS[cvd]
    return {
        "format": FORMAT,
        "version": 1,
        "study": key.study,
        "participant": f"{seed:x}",
        "arrangement": row,
        "cvd": cvd,
        "answers": answers,
    }


def saved(folder: Path, values: dict[str, Any]) -> Path:
    """The session as a file."""
    path = folder / f"answers-{values['participant']}.json"
    path.write_text(json.dumps(values), encoding="utf-8")
    return path
